"""People drawn at random: bodies, clinical profiles by condition and severity, populations."""
