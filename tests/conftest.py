"""What all files of tests share: tests that need OpenGL say so with the mark `needs_gl`.

They are skipped where there is none, unless the environment variable RCARE_MARL_REQUIRE_GL is set: then
they fail, so that a machine that should have it cannot pass without.
"""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Iterator
from functools import cache
from typing import TYPE_CHECKING

import pytest

from rcare_marl.errors import MissingPackageError, RenderingError

if TYPE_CHECKING:
    from rcare_marl.envs.care_env import CareEnv

REQUIRED = "RCARE_MARL_REQUIRE_GL"
# Read when Torch and BLAS are imported: beside other tests more threads would only wait for each other.
os.environ.setdefault("OMP_NUM_THREADS", "1")


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", f"needs_gl: draws with OpenGL; must not skip if {REQUIRED}")
    gc.disable()  # until all is collected: modules and tests stay, and looking through them is slow


def pytest_collection_finish() -> None:
    gc.collect()
    gc.freeze()  # what was collected is not looked through again with each large collection
    gc.enable()


def pytest_runtest_setup(item: pytest.Item) -> None:
    missing = gl_missing() if item.get_closest_marker("needs_gl") is not None else ""
    if missing and os.environ.get(REQUIRED):
        pytest.fail(f"{REQUIRED} is set, but there is {missing}", pytrace=False)
    if missing:
        pytest.skip(missing)


@pytest.fixture(scope="session")
def usual() -> Iterator[Callable[[str], CareEnv]]:
    """Give the environment of a task with its usual cast, made once: who changes settings restores them."""
    import rcare_marl

    made: dict[str, CareEnv] = {}

    def of(task: str) -> CareEnv:
        if task not in made:
            made[task] = rcare_marl.make(task)
        return made[task]

    yield of
    for env in made.values():
        env.close()


@cache
def gl_missing() -> str:
    """Return why nothing can be drawn with OpenGL here, empty if it can."""
    from rcare_marl.rendering.gl_target import create_context

    try:
        create_context().release()
    except (RenderingError, MissingPackageError) as error:
        return str(error)
    return ""
