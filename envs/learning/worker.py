"""Processes that run environments. Numbers pass through shared memory, pipes carry only signals."""

from __future__ import annotations

import multiprocessing
import pickle
import signal
import traceback
import warnings
import weakref
from collections.abc import Sequence
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

import numpy as np

from rcare_marl.errors import ConfigError, RcareError, WorkerError

from ..registry import task_class
from ..task import Task
from .learner_env import Layout
from .recipe import EnvRecipe
from .station import Board, Station

Reply = tuple[Any, Exception | None, str | None]  # value, exception, traceback
PATIENCE = 5.0  # [s] for a worker to end by itself; our own choice


def check_whole(name: str, value: object, least: int) -> None:
    """Raise a ConfigError where a value is no whole number from `least` on."""
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise ConfigError(f"{name} must be a whole number from {least} on, got {value!r}")


def check_batch(recipe: EnvRecipe, count: int, workers: int, seed: int) -> None:
    """Refuse impossible numbers of a batch, and warn where variants have unequal shares.

    Raises:
        ConfigError: It says which number is impossible.
    """
    check_whole("count", count, 1)
    check_whole("workers", workers, 0)
    check_whole("seed", seed, 0)
    if workers > count:
        raise ConfigError(f"{workers} workers for {count} environments: one each is the most")
    if recipe.variants and count % len(recipe.variants):
        warnings.warn(
            f"{count} environments cannot be shared evenly by {len(recipe.variants)} variants",
            stacklevel=3,
        )


class Crew:
    """The environments of a batch, spread over worker processes or all in this one.

    Attributes:
        layout: Of each environment.
        board: The arrays of the batch.
    """

    def __init__(self, recipe: EnvRecipe, *, count: int, workers: int, seed: int) -> None:
        """Start the workers and build the scenes.

        Args:
            recipe: What the environments are made of.
            count: How many environments.
            workers: How many processes; 0 for none.
            seed: Of the batch.

        Raises:
            ConfigError: If the spaces of two variants differ, or a value is impossible.
            WorkerError: If a worker fails otherwise.
        """
        self._connections: list[Connection] = []
        self._processes: list[BaseProcess] = []
        self._owed: list[int] = []  # replies that a worker has still to give
        self._station: Station | None = None
        self._rest: list[Any] = []  # what has to be closed, the board and the station
        self._end = weakref.finalize(self, _end, self._connections, self._processes, self._rest)
        try:
            if workers:
                self._start(recipe, seed, np.array_split(np.arange(count), workers))
            else:
                self._station = Station(recipe, seed, range(count))
                self._rest.append(self._station)
            layouts = [layout for each in self.call("layouts") for layout in each]
            self.layout = _same(recipe, layouts)
            self.board = Board(self.layout, count, is_shared=workers > 0)
            self._rest.append(self.board)
            if self._station is None:
                self.call("attach", (self.layout, count, self.board.name))
            else:
                self._station.attach(self.board)
        except BaseException:
            self.close()
            raise

    def _start(self, recipe: EnvRecipe, seed: int, shares: Sequence[Any]) -> None:
        # Spawned, not forked: the learner's threads and its own scenes stay out of the workers.
        context = multiprocessing.get_context("spawn")
        for number, share in enumerate(shares):
            ours, theirs = context.Pipe()
            process = context.Process(
                target=serve,
                # The task's class brings along the module that registers it.
                args=(theirs, task_class(recipe.task), recipe, seed, share.tolist()),
                name=f"rcare_marl environments {number}",
                daemon=True,
            )
            self._connections.append(ours)
            self._processes.append(process)
            self._owed.append(0)
            process.start()
            theirs.close()

    def call(self, name: str, argument: Any = None) -> list[Any]:
        """Call a method of every station and return what each gave.

        Raises:
            RcareError: If a station raises one, of that class.
            WorkerError: If a worker raises anything else or dies; the others are ended then.
        """
        if self._station is not None:
            return [_called(self._station, name, argument)]
        try:
            for number in range(len(self._connections)):
                while self._owed[number]:  # of a call that was interrupted
                    self._receive(number)
            for number, connection in enumerate(self._connections):
                try:
                    connection.send((name, argument))
                except OSError:
                    raise self._dead(number) from None
                self._owed[number] += 1
            return [self._receive(number) for number in range(len(self._connections))]
        except Exception:
            self.close()
            raise

    def _receive(self, number: int) -> Any:
        try:
            value, error, trace = self._connections[number].recv()
        except (EOFError, OSError):
            raise self._dead(number) from None
        self._owed[number] -= 1
        if trace is None:
            return value
        told = WorkerError(f"worker {number} failed:\n{trace}")
        if isinstance(error, RcareError):
            raise error from told
        raise told

    def _dead(self, number: int) -> WorkerError:
        process = self._processes[number]
        process.join(PATIENCE)
        return WorkerError(
            f"worker {number} died, exit code {process.exitcode}. What it said stands above; a script "
            "that starts workers needs `if __name__ == '__main__':` around what it does"
        )

    def close(self) -> None:
        """End the workers and free everything; safe to call twice."""
        self._end()


def _end(connections: list[Connection], processes: list[BaseProcess], rest: list[Any]) -> None:
    """End workers: ask, wait, and then insist."""
    for connection in connections:
        try:
            connection.send(("close", None))
        except (OSError, ValueError):
            pass  # it ended before
    for process in processes:
        if process.pid is None:
            continue  # it never started
        process.join(PATIENCE)
        if process.is_alive():
            process.kill()
            process.join(PATIENCE)
    for connection in connections:
        connection.close()
    for part in rest:
        part.close()


def _same(recipe: EnvRecipe, layouts: Sequence[Layout]) -> Layout:
    """Return the layout of all environments; ConfigError if a variant differs."""
    first = layouts[0]
    for place, layout in enumerate(layouts):
        if layout != first:
            what = next(n for n in vars(first) if getattr(first, n) != getattr(layout, n))
            raise ConfigError(
                f"variants must have equal spaces: {what} of variant {place % len(recipe.variants)}, "
                f"{dict(recipe.variants[place % len(recipe.variants)])}, is {getattr(layout, what)}, "
                f"that of variant 0 is {getattr(first, what)}"
            )
    return first


def _called(station: Station, name: str, argument: Any) -> Any:
    method = getattr(station, name)
    return method() if argument is None and name == "layouts" else method(argument)


def serve(
    connection: Connection, task: type[Task], recipe: EnvRecipe, seed: int, places: Sequence[int]
) -> None:
    """Run environments until the learner says so or is gone.

    Args:
        connection: To the learner: it sends (method of `Station`, argument) and gets back
            (value, exception, traceback).
        task: The recipe's task, which is registered by being imported.
        recipe: What the environments are made of.
        seed: Of the batch.
        places: Numbers of the environments in the batch.
    """
    # For the learner, who ends us: all of a job get them.
    for kind in (signal.SIGINT, signal.SIGTERM):
        signal.signal(kind, signal.SIG_IGN)
    station: Station | None = None
    board: Board | None = None
    while True:
        try:
            name, argument = connection.recv()
        except (EOFError, OSError):
            name, argument = "close", None
        if name == "close":
            break
        try:
            if station is None:
                station = Station(recipe, seed, places)
            if name == "attach":
                layout, count, memory = argument
                board = Board(layout, count, name=memory)
                argument = board
            reply: Reply = (_called(station, name, argument), None, None)
        except Exception as error:
            reply = (None, _sendable(error), traceback.format_exc())
        try:
            connection.send(reply)
        except OSError:
            break
    if station is not None:
        station.close()
    if board is not None:
        board.close()


def _sendable(error: Exception) -> Exception | None:
    """Return an exception if it survives the way to another process."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # whatever a foreign class raises: its traceback is sent in any case
        return None
    return error
