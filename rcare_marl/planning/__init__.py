"""Paths around everything: who is clear of what, a search for a way, and the times along it."""
