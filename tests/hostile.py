"""What is promised of all that comes in: taken, or refused soon, in a few words and with little memory."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable
from typing import Any

from rcare_marl.errors import LONGEST, RcareError

SOON = 5.0  # [s] of the processor
MOST = 2 << 30  # [bytes] more than the process ever had before
REFUSED = object()


def peak() -> int:
    """Return the most memory that the process ever had [bytes]."""
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def try_out(call: Callable[[], Any], what: object) -> Any:
    """Return what a call gives, `REFUSED` where it refuses; nothing else may come of it."""
    begun, before, result = time.process_time(), peak(), REFUSED
    try:
        result = call()
    except RcareError as error:
        assert len(str(error)) <= LONGEST
    assert time.process_time() - begun < SOON, f"slow: {what!r:.300}"
    assert peak() - before < MOST, f"large: {what!r:.300}"
    return result
