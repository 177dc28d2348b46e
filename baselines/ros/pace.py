"""Real time for a process that must answer in milliseconds; knows no transport."""

from __future__ import annotations

import gc
import os
import threading
import time
from collections.abc import Callable

import numpy as np

from rcare_marl.console import print_line

LAG = 0.1  # [s] that steps may lag behind real time before what is lost is given up; our own choice
NICE = -15  # priority of a process in real time, -20 to 19; our own choice


def make_ready() -> bool:
    """Go before all ordinary processes where the system permits, else say so; return whether it does.

    Threads that are started later go along. What is in memory is not searched for garbage again, which
    takes 0.1 s.
    """
    gc.freeze()
    try:
        os.setpriority(os.PRIO_PROCESS, 0, NICE)
    except (AttributeError, PermissionError):  # not on every system, and not for everybody
        print_line("no priority over others (ulimit -e): a busy machine may make messages late")
        return False
    return True


class Pace:
    """Keeps real time: called before each step, it waits until that is due.

    Attributes:
        late: How late each step began [s].
        slips: How often more than `LAG` was lost and given up.
    """

    def __init__(
        self, period: float, lock: threading.Lock, on_step: Callable[[int], object]
    ) -> None:
        """Take the time between steps [s], a lock that is let go meanwhile, and who is told each number."""
        self._period, self._lock, self._on_step = period, lock, on_step
        self.late: list[float] = []
        self.slips = 0
        self.start()

    def start(self) -> None:
        """Count from now on."""
        self._due = time.monotonic()

    def __call__(self) -> None:
        """Wait until the next step is due; the lock is held before and after."""
        self._on_step(len(self.late))
        self._due += self._period
        self._lock.release()
        try:
            time.sleep(max(self._due - time.monotonic(), 0.0))
        finally:
            self._lock.acquire()
        late = time.monotonic() - self._due
        self.late.append(late)
        if late > LAG:
            self.slips += 1
            self.start()

    def told(self) -> str:
        """Return in words how late steps began."""
        if not self.late:
            return "no step was made"
        middle, most = (1e3 * float(np.percentile(self.late, part)) for part in (50, 99.9))
        return (
            f"{len(self.late)} steps of {1e3 * self._period:.1f} ms began {middle:.1f} ms late (median), "
            f"999 of 1000 less than {most:.0f} ms, {1e3 * max(self.late):.0f} ms at most; "
            f"{self.slips} times lost time was given up"
        )
