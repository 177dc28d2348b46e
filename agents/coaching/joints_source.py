"""The name under which scripts of others import `sources.joints_source`."""

from .sources.joints_source import JointsSource

__all__ = ["JointsSource"]
