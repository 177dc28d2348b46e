"""Signals that end a command: raised where an exception is one, or told to what serves a page."""

from __future__ import annotations

import asyncio
import signal
import threading
from collections.abc import Callable, Coroutine
from types import FrameType
from typing import Any

from rcare_marl.console import print_line

Handler = Callable[[int, "FrameType | None"], object]


def postponed(handler: Handler) -> Handler:
    """Let signals wait while Numba boxes what a kernel returns: of a tuple it makes a `SystemError` then.

    Args:
        handler: Of the signal; may raise.

    Source: `tests/test_interruption.py`, which shows it.
    """

    def handle(number: int, frame: FrameType | None) -> None:
        running = frame
        while running is not None and running.f_code.co_name != "_numba_unpickle":
            running = running.f_back
        if running is None:
            handler(number, frame)
        else:
            threading.Timer(0.001, signal.raise_signal, (number,)).start()

    return handle


def run_until_interrupted(serving: Coroutine[Any, Any, None]) -> None:
    """Run what serves a page. Ctrl-C cancels it and is the way to end it, so no failure."""
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)  # asyncio takes over no other
    try:
        asyncio.run(serving)
    except KeyboardInterrupt:
        print_line("stopped")
