"""The name under which scripts of others import `sources.hands_source`."""

from .sources.hands_source import HandsReading, HandsSource

__all__ = ["HandsReading", "HandsSource"]
