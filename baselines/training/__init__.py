"""Training: from a config to a policy file."""
