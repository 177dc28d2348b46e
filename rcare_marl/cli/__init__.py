"""The command `rcare-marl`: look at tasks, watch them, measure policies and speed."""

from .app import app, main

__all__ = ["app", "main"]
