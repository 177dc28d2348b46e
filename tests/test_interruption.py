"""Ctrl-C and SIGTERM: they end a command as themselves, wherever they come."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from typing import Any

import numba
import numpy as np
import pytest
from numba.core import serialize

from rcare_marl.cli.interruption import postponed


@numba.njit
def kernel() -> Any:
    return np.zeros(3), np.zeros(3)


class Signalled(dict[Any, Any]):
    """What Numba looks up while it boxes arrays; a signal comes in the middle of it, once."""

    came = 0

    def __getitem__(self, key: Any) -> Any:
        self.came += 1
        if self.came == 1:
            signal.raise_signal(signal.SIGINT)
        return super().__getitem__(key)


@pytest.fixture
def boxing(monkeypatch: pytest.MonkeyPatch) -> Iterator[Signalled]:
    kernel()
    memo = Signalled(serialize._unpickled_memo)
    monkeypatch.setattr(serialize, "_unpickled_memo", memo)
    before = signal.getsignal(signal.SIGINT)
    yield memo
    signal.signal(signal.SIGINT, before)


def test_an_interrupt_while_a_kernel_returns_stays_an_interrupt(boxing: Signalled) -> None:
    signal.signal(signal.SIGINT, postponed(signal.default_int_handler))
    with pytest.raises(KeyboardInterrupt):
        kernel()
        assert boxing.came
        time.sleep(5)


def test_numba_still_turns_interrupts_into_another_error(boxing: Signalled) -> None:
    """If it no longer does, `postponed` can go."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with pytest.raises(SystemError):
        kernel()
