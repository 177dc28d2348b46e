"""The muscles of a person as lines to draw, coloured by activation from blue to red."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, matrix_from_quaternion
from rcare_marl.world import World

from ..body.bone_lines import BoneLines
from ..body.skin import PersonSkin
from ..human import Human
from . import muscle_kernel as kernel
from .muscle_model import MuscleModel
from .muscle_path import X
from .muscular import MuscleDrive

RELAXED, FULL = (66, 116, 226), (232, 30, 24)  # sRGB
# A tube's radius grows with that of the muscle's cross-section; our own choice of scale.
_RADIUS_PER_ROOT = 1.1e-4  # [m/√N]
_LEAST_RADIUS, _MOST_RADIUS = 0.0015, 0.0045  # [m]


def activation_color(activation: Array) -> npt.NDArray[np.uint8]:
    """Return the colour of activations in [0, 1], shape [..., 3]: relaxed blue to full red."""
    share = np.clip(activation, 0.0, 1.0)[..., None]
    mixed = np.array(RELAXED) * (1 - share) + np.array(FULL) * share
    return np.asarray(np.round(mixed), np.uint8)


def path_points(model: MuscleModel, q: Array) -> Array:
    """Return the points of all paths at joint angles `q` [rad], in the pelvis' frame [m], [p, 3].

    The points of muscle i begin at `model.layout.starts[i, 0]`.
    """
    model.lengths(q)
    return model.kernel_muscles.spots[X : X + 3].T.copy()


class MuscleLines:
    """The muscles of a spawned, muscle-driven person: implements `rcare_marl.world.Lines`."""

    def __init__(self, person: Human) -> None:
        """Follow a person.

        Args:
            person: Someone who has been spawned with `actuation: muscle`.

        Raises:
            ConfigError: If the person is not driven by muscles.
        """
        if not isinstance(person.drive, MuscleDrive):
            raise ConfigError(
                f"{person.name!r} has no muscles to draw: cast the person with actuation muscle"
            )
        self._person, self._drive = person, person.drive
        self.model = person.drive.model
        self.starts = np.ascontiguousarray(self.model.layout.starts[:, 0])
        radius = _RADIUS_PER_ROOT * np.sqrt(self.model.table[:, kernel.FORCE])
        radius = np.clip(radius, _LEAST_RADIUS, _MOST_RADIUS)
        self._owner = np.repeat(np.arange(len(self.model.names)), np.diff(self.starts))
        self.radii = radius[self._owner].astype(np.float32)

    def activations(self) -> Array:
        """Return the present activation of each muscle, in [0, 1], shape [m]."""
        return self._drive.state[kernel.ACTIVATION].copy()

    def points(self) -> npt.NDArray[np.float32]:
        """Return the present points of all paths in the world [m], shape [p, 3]."""
        q, _ = self._person.body.joint_states(self._person.body.indices(self._drive.names))
        pelvis = self._person.joint_pose("pelvis")
        local = path_points(self.model, np.array(q))
        turned = local @ matrix_from_quaternion(pelvis.quaternion).T
        return np.asarray(turned + pelvis.position, np.float32)

    def colors(self) -> npt.NDArray[np.uint8]:
        """Return the present colour of each point, shape [p, 3]."""
        return activation_color(self.activations())[self._owner]


def show_muscles(person: Human, world: World, *, opacity: float = 0.0) -> MuscleLines:
    """Draw a person as muscles on bones, in all pictures of a world from now on.

    Args:
        person: Someone who has been spawned in the world with `actuation: muscle`.
        world: The world.
        opacity: Of the skin, in [0, 1]; 0 hides it.

    Raises:
        ConfigError: If the person is not driven by muscles, or the opacity is impossible.
    """
    if not 0 <= opacity <= 1:
        raise ConfigError(f"opacity must lie in [0, 1], got {opacity}")
    muscles = MuscleLines(person)
    for skin in world.skins:
        if isinstance(skin, PersonSkin) and skin.body is person.body:
            world.lines.extend((BoneLines(skin), muscles))
            alpha = np.full((len(skin.colors), 1), round(255 * opacity), np.uint8)
            skin.colors = np.hstack((skin.colors[:, :3], alpha))
    return muscles
