"""Robots: models, arms, grippers, bases, control."""
