"""A hand-written robot that bathes: come over the shoulder, press softly, wipe to the elbow, lift.

It shows that the task can be done. It sees what a robot with perfect perception would see, presses by
what the sponge feels, and needs the control mode `tool_delta`.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.registry import register_policy
from rcare_marl.envs.tasks.bathing import START_ANGLE, START_SHARE, Bathing
from rcare_marl.pose import conjugate, multiply, rotation_vector

from .tool_script import scripted_task

Array = npt.NDArray[np.float64]

# All our own choices.
PRESS = 5.0  # [N], within PhyRC's 1 to 6 N of comfort
HOVER = 0.03  # [m] over the skin, before it presses
NEAR = 0.02  # [m] from a place, and
LEVEL = 0.3  # [rad], that counts as there: some hands cannot lay it flat
GAIN, TURN_GAIN = 2.5, 2.5  # [1/s]
YIELD = 0.006  # [m/s] into the skin for each newton that is lacking
FAST, SINK, WIPE = 0.20, 0.04, 0.06  # [m/s] through the air, onto the skin, along it
BEYOND = 0.01  # [m] past the target, before another pass is made
TOUCH = 0.5  # [N] that count as contact


class ScriptedBathing:
    """Comes over the shoulder, presses until it feels 5 N, wipes to the target, and lifts."""

    def __init__(self, env: CareEnv, role: str) -> None:
        """Take the environment and the robot's role.

        Raises:
            ConfigError: If the task is not bathing, or the robot has another control mode.
        """
        self._task = scripted_task(env, role, Bathing)
        self._robot = self._task.robot
        self._phase = "approach"

    def reset(self, rng: np.random.Generator) -> None:
        self._phase = "approach"

    def act(self) -> Array:
        task, skin, seen = self._task, self._task.skin, self._task.state
        face = seen.face
        share = skin.progress(face)
        end, angle = task.target_on_arm()
        done = min(max((share - START_SHARE) / (end - START_SHARE), 0.0), 1.0)
        top, out = skin.place(
            START_SHARE + done * (end - START_SHARE), START_ANGLE + done * (angle - START_ANGLE)
        )
        way = skin.direction()
        turn = rotation_vector(multiply(task.wiping_quaternion(out, way), conjugate(seen.turn)))
        start = skin.place(START_SHARE, START_ANGLE)[0]
        height, force = float((face - top) @ out), float(-seen.push @ out)
        ahead = float((seen.target - face) @ way)
        self._phase = self._next(start, out, turn, ahead, height, force)
        if self._phase in ("approach", "lift"):
            goal = start if self._phase == "approach" else top
            linear = _limited(GAIN * (goal + HOVER * out - face), FAST)
        else:
            aside = float((top - face) @ np.cross(out, way))
            into = YIELD * (PRESS - force) if force > TOUCH else SINK
            along = WIPE if self._phase == "wipe" else 0.0
            linear = along * way + GAIN * aside * np.cross(out, way)
            linear = linear - float(np.clip(into, -SINK, SINK)) * out
        # The tool turns about the face, so that turning does not wipe.
        turn = TURN_GAIN * turn
        linear = linear + np.cross(turn, np.subtract(self._robot.tool_pose().position, face))
        return self._robot.tool_action(linear, turn)

    def _next(
        self, start: Array, out: Array, turn: Array, ahead: float, height: float, force: float
    ) -> str:
        """Return what to do now."""
        there = start + HOVER * out - self._task.state.face
        if self._phase == "approach":
            is_there = np.linalg.norm(there) < NEAR and np.linalg.norm(turn) < LEVEL
            return "press" if is_there else "approach"
        if self._phase == "press":
            return "wipe" if force > 0.6 * PRESS else "press"
        if self._phase == "wipe":
            return "lift" if ahead < -BEYOND else "wipe"
        return "approach" if height > 0.8 * HOVER else "lift"


def _limited(velocity: Array, most: float) -> Array:
    return velocity * min(1.0, most / max(float(np.linalg.norm(velocity)), 1e-9))


register_policy("bathing", "robot", "scripted")(ScriptedBathing)
