"""Sensors that any agent can be given: kinds in `suite`, see docs/sensors.md."""
