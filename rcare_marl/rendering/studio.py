"""The cameras of a world behind one renderer, so that those that look at the same time look together."""

from __future__ import annotations

import weakref
from collections.abc import Callable

from ..errors import WorldError
from ..world import World
from .shot import Picture, Shot

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
    """All viewpoints of a world. The first one makes the renderer; nothing is drawn until one is read.

    When one is read, so are all that will be read at this moment as well: those without a rate, and
    those of the same rate that were last read together with it. A wrong guess costs time, nothing else.
    """

    def __init__(self, world: World) -> None:
        from . import Renderer

        self._world = world
        self._viewpoints: list[Viewpoint] = []
        self._renderer: Renderer | None = None

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
            rate: How often it will be read [Hz]; 0 if whenever anything is.
        """
        if self._renderer is None:  # now, as how it draws people may depend on how they sit
            from . import make_renderer

            self._renderer = make_renderer(self._world)
        self._viewpoints.append(Viewpoint(self, aim, rate))
        return self._viewpoints[-1]

    def _read(self, asked: Viewpoint) -> tuple[Shot, Picture]:
        now = self._world.step_count, self._world.teleports
        if asked.waiting is None or asked.waiting[0] != now:
            due = [v for v in self._viewpoints if v is asked or self._goes_along(v, asked)]
            shots = [viewpoint.aim() for viewpoint in due]
            assert self._renderer is not None
            for viewpoint, shot, picture in zip(
                due, shots, self._renderer.read(shots), strict=True
            ):
                viewpoint.waiting, viewpoint.last = (now, shot, picture), now
        assert asked.waiting is not None
        _, shot, picture = asked.waiting
        asked.waiting = None
        return shot, picture

    def _goes_along(self, other: Viewpoint, asked: Viewpoint) -> bool:
        return not other.rate or (other.rate, other.last) == (asked.rate, asked.last)

    def labels(self) -> dict[int, tuple[str, str]]:
        """Return name of body and link by their number in segmentations."""
        from .shot import Labels

        return Labels(self._world).names

    def _leave(self, viewpoint: Viewpoint) -> None:
        self._viewpoints.remove(viewpoint)
        if not self._viewpoints and self._renderer is not None:
            self._renderer.close()
            self._renderer = None


__all__ = ["Studio", "Viewpoint"]
