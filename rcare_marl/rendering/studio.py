"""The cameras of a world behind one renderer, so that those that look at the same time look together."""

from __future__ import annotations

import weakref
from collections.abc import Callable

from ..errors import WorldError
from ..world import World
from .piece import SkinCuts
from .renderer import Renderer
from .shot import Labels, Picture, Shot

Moment = tuple[int, int]  # physics steps, teleports

_STUDIOS: weakref.WeakValueDictionary[int, Studio] = weakref.WeakValueDictionary()


class Viewpoint:
    """A place in a studio from which pictures are taken again and again."""

    def __init__(self, studio: Studio, aim: Callable[[], Shot], rate: float) -> None:
        self._studio: Studio | None = studio
        self.aim, self.rate = aim, rate
        self.last: Moment | None = None
        self.waiting: tuple[Moment, Shot, Picture] | None = None

    def read(self) -> tuple[Shot, Picture]:
        """Return what is seen now, and by which camera.

        Raises:
            WorldError: If the viewpoint was left, or the world is closed.
        """
        if self._studio is None:
            raise WorldError("this camera is closed")
        return self._studio._read(self)

    def leave(self) -> None:
        """Take no more pictures; the last to leave frees the renderer. Safe to call twice."""
        if self._studio is not None:
            self._studio._leave(self)
            self._studio = None


class Studio:
    """All viewpoints of a world. The first reading makes the renderer, which the last to leave frees.

    Until then nothing touches OpenGL: an environment may be made in one process to learn its spaces and
    be used in others that are forked from it.

    When one is read, so are all that will be read at this moment as well: those of the same rate that
    were last read together with it, and if it has no rate, all without one. They are read whenever
    agents observe, and not when one with a rate is. A wrong guess costs time, nothing else.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._viewpoints: list[Viewpoint] = []
        self._renderer: Renderer | None = None
        self._cuts: SkinCuts | None = None

    @classmethod
    def of(cls, world: World) -> Studio:
        """Return the studio of a world; it lives as long as somebody has a viewpoint in it."""
        studio = _STUDIOS.get(id(world))  # a studio keeps its world, so no other has its id
        if studio is None:
            studio = _STUDIOS[id(world)] = cls(world)
        return studio

    def enter(self, aim: Callable[[], Shot], rate: float = 0.0) -> Viewpoint:
        """Return a new viewpoint.

        Args:
            aim: Returns the shot to take at present.
            rate: How often it will be read [Hz]; 0 if whenever agents observe.

        Raises:
            ConfigError: If the environment variable RCARE_MARL_RENDERER is none of `BACKENDS`.
        """
        if self._cuts is None:  # now, as pictures in software depend on how people sit
            from . import chosen_backend

            chosen_backend()
            self._cuts = SkinCuts(self._world)
        self._viewpoints.append(Viewpoint(self, aim, rate))
        return self._viewpoints[-1]

    def _read(self, asked: Viewpoint) -> tuple[Shot, Picture]:
        now = self._world.step_count, self._world.teleports
        if asked.waiting is None or asked.waiting[0] != now:
            due = [v for v in self._viewpoints if v is asked or self._goes_along(v, asked)]
            shots = [viewpoint.aim() for viewpoint in due]
            pictures = self._open().read(shots)
            for viewpoint, shot, picture in zip(due, shots, pictures, strict=True):
                viewpoint.waiting, viewpoint.last = (now, shot, picture), now
        assert asked.waiting is not None
        _, shot, picture = asked.waiting
        asked.waiting = None
        return shot, picture

    def _goes_along(self, other: Viewpoint, asked: Viewpoint) -> bool:
        return other.rate == asked.rate and (not asked.rate or other.last == asked.last)

    def _open(self) -> Renderer:
        if self._renderer is None:
            from . import make_renderer

            self._renderer = make_renderer(self._world, cuts=self._cuts)
        return self._renderer

    def labels(self) -> dict[int, tuple[str, str]]:
        """Return name of body and link by their number in segmentations."""
        return Labels(self._world).names

    def _leave(self, viewpoint: Viewpoint) -> None:
        self._viewpoints.remove(viewpoint)
        if self._viewpoints:
            return
        if self._renderer is not None:
            self._renderer.close()
        self._renderer = self._cuts = None
