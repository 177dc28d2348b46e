"""PyBullet, loaded without the line about its build that it prints."""

from __future__ import annotations

import os
import sys
from types import ModuleType


def _loaded() -> ModuleType:
    """Return PyBullet; what its C code prints on standard error as it is loaded goes nowhere."""
    try:
        kept = os.dup(2)
    except OSError:  # there is no standard error
        kept = -1
    if "pybullet" not in sys.modules and kept >= 0:
        sink = os.open(os.devnull, os.O_WRONLY)
        os.dup2(sink, 2)
        os.close(sink)
    try:
        import pybullet
    finally:
        if kept >= 0:
            os.dup2(kept, 2)
            os.close(kept)
    return pybullet


bullet = _loaded()
