"""Sensors that any agent can be given: kinds in `registry`, see docs/sensors.md."""
