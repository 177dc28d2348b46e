"""What to read of a camera, and what a reading is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy.typing as npt

from ..errors import ConfigError, check_name
from ..world import World
from .camera import Camera
from .light import Light

Output = Literal["rgb", "depth", "normals", "segmentation"]
Look = Literal["full", "plain"]
Picture = dict[str, npt.NDArray[Any]]

OUTPUTS: tuple[Output, ...] = get_args(Output)
LOOKS: tuple[Look, ...] = get_args(Look)


@dataclass(frozen=True)
class Shot:
    """A camera and what to read of it.

    Outputs, each one array of the picture that `Renderer.read` returns:

    - `rgb`: colours, uint8, shape [height, width, 3];
    - `depth`: distance along the optical axis [m], float32, shape [height, width]; inf for nothing;
    - `normals`: unit normals of what is seen in the optical frame (z forward, x right, y down),
      float32, shape [height, width, 3]; zero for nothing;
    - `segmentation`: which link is seen, by the numbers of `Renderer.labels`, int32, shape
      [height, width]; -1 for nothing and for what belongs to no body.

    What is transparent is seen by `rgb` alone. The middle of a pixel counts: there is no mixing of what
    is near and far at an edge, except in the colours of a `full` look.

    Attributes:
        camera: Where from.
        outputs: What to read.
        look: Of `rgb`: `full` as in films, or `plain` without shadows, ambient occlusion and smooth
            edges, several times as fast.
        light: Of `rgb`.

    Raises:
        UnknownNameError: If an output or a look does not exist.
        ConfigError: If there is no output.
    """

    camera: Camera
    outputs: Sequence[Output] = ("rgb",)
    look: Look = "full"
    light: Light = Light()

    def __post_init__(self) -> None:
        check_name("look of a picture", self.look, LOOKS)
        if isinstance(self.outputs, str) or not self.outputs:
            raise ConfigError(f"outputs must be some of {', '.join(OUTPUTS)}, got {self.outputs!r}")
        for output in self.outputs:
            check_name("output of a camera", output, OUTPUTS)

    @property
    def wants_rgb(self) -> bool:
        """Whether colours are wanted."""
        return "rgb" in self.outputs

    @property
    def wants_shape(self) -> bool:
        """Whether anything but colours is wanted."""
        return any(output != "rgb" for output in self.outputs)


class Labels:
    """The numbers of all links of a world in segmentations, bodies in the order of loading.

    Attributes:
        names: Name of body and link by number.
    """

    def __init__(self, world: World) -> None:
        self._first: dict[int, int] = {}
        self.names: dict[int, tuple[str, str]] = {}
        for body in world.bodies:
            self._first[body.uid] = len(self.names)
            for link in range(-1, body.link_count):
                self.names[len(self.names)] = body.name, body.link_names.get(link, str(link))

    def of(self, uid: int, link: int) -> int:
        """Return the number of a link; -1 is the base."""
        return self._first[uid] + 1 + link
