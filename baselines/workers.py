"""Work side by side in several processes, which leave nothing behind."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, as_completed, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from typing import TypeVar

from rcare_marl.errors import ConfigError, WorkerError

T = TypeVar("T")


@contextmanager
def workers(count: int) -> Iterator[ProcessPoolExecutor]:
    """Give processes, and leave none behind: not after an error, nor after Ctrl-C.

    They are started afresh (`spawn`), as physics clients must not be shared by a fork.
    """
    before = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(
        count,
        mp_context=multiprocessing.get_context("spawn"),
        initializer=signal.signal,
        initargs=(signal.SIGINT, signal.SIG_DFL),  # Ctrl-C ends them without a traceback each
    )
    try:
        yield pool
    except BaseException:
        for process in set(multiprocessing.active_children()) - before:
            process.terminate()
        pool.shutdown(wait=True, cancel_futures=True)
        raise
    pool.shutdown()


def run_all(
    calls: Sequence[Callable[[], T]], processes: int, on_done: Callable[[int], None]
) -> list[T]:
    """Return what each call gives, in their order, the same however many `processes` there are.

    Args:
        calls: What to do; they must survive the way to another process.
        processes: How many at once. More than one are started afresh (`spawn`), so a script that asks
            for them needs `if __name__ == "__main__":`.
        on_done: Told the number of each call that is done. The first error ends all.

    Raises:
        ConfigError: If `processes` is below 1.
    """
    if processes < 1:
        raise ConfigError(f"processes must be at least 1, got {processes}")
    if processes == 1:
        out = []
        for number, call in enumerate(calls):
            out.append(call())
            on_done(number)
        return out
    with workers(min(processes, len(calls))) as pool:
        running = {pool.submit(call): number for number, call in enumerate(calls)}
        for done in as_completed(running):
            done.result()
            on_done(running[done])
        return [job.result() for job in running]


def one_count(what: str, given: str) -> int:
    """Return the number of processes of a benchmark that takes one; ConfigError if it is none."""
    if not given.isdecimal() or not int(given):
        raise ConfigError(f"processes of {what} must be one count, got {given!r}")
    return int(given)


def run_each(
    calls: Sequence[Callable[[], T]],
    processes: int,
    on_done: Callable[[int, T | BaseException], None],
) -> None:
    """Do each call, and go on where one fails: a process that is killed costs the call that it did.

    Args:
        calls: What to do; they must survive the way to another process.
        processes: How many at once, see `run_all`. A single one is this process itself.
        on_done: Told the number of each call, and what it gave or raised.

    Raises:
        ConfigError: If `processes` is below 1.
    """
    if processes < 1:
        raise ConfigError(f"processes must be at least 1, got {processes}")
    if processes == 1:
        for number, call in enumerate(calls):
            on_done(number, _outcome(call))
        return
    left = iter(enumerate(calls))
    running: dict[Future[T], tuple[int, ProcessPoolExecutor]] = {}
    with ExitStack() as stack:
        idle = [stack.enter_context(workers(1)) for _ in range(min(processes, len(calls)))]
        while True:
            while idle and (following := next(left, None)) is not None:
                number, call = following
                pool = idle.pop()
                running[pool.submit(call)] = (number, pool)
            if not running:
                return
            for job in wait(running, return_when=FIRST_COMPLETED).done:
                number, pool = running.pop(job)
                found = _outcome(job.result)
                if isinstance(found, BrokenProcessPool):
                    found = WorkerError("its process was killed")
                    pool = stack.enter_context(workers(1))
                idle.append(pool)
                on_done(number, found)


def _outcome(call: Callable[[], T]) -> T | Exception:
    """Return what a call gives, or what it raises."""
    try:
        return call()
    except Exception as error:
        return error
