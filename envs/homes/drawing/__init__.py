"""Drawings of homes: floor plans, perspectives, and where to stand to see a room."""
