"""How a person's joints are driven."""
