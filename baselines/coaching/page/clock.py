"""The page's clock, which is not ours and need not be honest."""

from __future__ import annotations

from .message import MessageError

SLACK = (
    1.0  # by how much the page's clock may gain on ours between two readings [s]; our own choice
)
ANEW = 2.0  # after so long with refused times only, it is taken as it is from there on [s]; our own choice


class PageClock:
    """Turns times of the page into times that only grow, and not faster than ours."""

    def __init__(self) -> None:
        self._page: float | None = None  # the last time that was taken, on the page's clock
        self._ours = 0.0  # when that was
        self._time = 0.0  # and what came out
        self._refused_at: float | None = None

    def take(self, page: float, now: float) -> float:
        """Return the time of a reading [s], counted from the first one.

        Args:
            page: On the page's clock [s].
            now: On ours [s], which only grows.

        Raises:
            MessageError: If the page's clock ran backwards, or far ahead of ours. Where it goes on so for
                two seconds its new time is taken from then on.
        """
        if self._page is None:
            self._page, self._ours = page, now
            return self._time
        gone, ours = page - self._page, now - self._ours
        if not 0 < gone <= ours + SLACK:
            if self._refused_at is None:
                self._refused_at = now
            if now - self._refused_at < ANEW:
                raise MessageError(
                    "the time of readings has to grow" if gone <= 0 else "that time lies ahead"
                )
            gone = max(ours, 1e-3)
        self._refused_at = None
        self._page, self._ours, self._time = page, now, self._time + gone
        return self._time
