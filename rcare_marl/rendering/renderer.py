"""What every renderer does."""

from __future__ import annotations

import abc
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ..errors import WorldError
from ..world import World
from .camera import Camera
from .shot import Labels, Picture, Shot


class Renderer(abc.ABC):
    """Takes pictures of one world; the physics is read, never changed."""

    def __init__(self, world: World) -> None:
        self._world = world

    def render(self, camera: Camera) -> npt.NDArray[np.uint8]:
        """Return the picture that `camera` takes, shape [height, width, 3]; errors as of `read`."""
        self._look_anew()
        return self.read([Shot(camera)])[0]["rgb"]

    def depth(self, camera: Camera) -> npt.NDArray[np.float32]:
        """Return depths along the optical axis [m], shape [height, width]; inf for nothing."""
        self._look_anew()
        return self.read([Shot(camera, ("depth",))])[0]["depth"]

    @abc.abstractmethod
    def read(self, shots: Sequence[Shot]) -> list[Picture]:
        """Return what each of several cameras sees at this moment, by output.

        Raises:
            WorldError: If the renderer or the world is closed.
        """

    def labels(self) -> dict[int, tuple[str, str]]:
        """Return name of body and link by their number in segmentations."""
        return Labels(self._world).names

    @abc.abstractmethod
    def refresh(self) -> None:
        """Read the shapes and colours of all bodies again."""

    @abc.abstractmethod
    def close(self) -> None:
        """Free what the renderer holds; safe to call twice."""

    @property
    @abc.abstractmethod
    def _is_closed(self) -> bool:
        """Whether `close` was called."""

    def _look_anew(self) -> None:
        """Forget what was found out about the present moment."""

    def _check_open(self) -> None:
        if self._is_closed:
            raise WorldError("this renderer is closed: make a new one")
        if self._world.client < 0:
            raise WorldError("the world of this renderer is closed")
