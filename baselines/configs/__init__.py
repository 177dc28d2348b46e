"""Configs of trainings that ship, one for each task and level."""
