"""The name under which scripts of others import `sources.landmark_source`."""

from .sources.landmark_source import LandmarkReading, LandmarkSource

__all__ = ["LandmarkReading", "LandmarkSource"]
