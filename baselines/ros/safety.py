"""What stands between a policy and a robot: it slows, or stops and says why. Knows no transport.

Times are seconds of one clock. What is not a number, comes late, twice or not at all, jumps, freezes or names
other joints stops the robot, as do forces and places beyond their limits; what the policy does wrong, too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, Vector

Box = tuple[Vector, Vector]
SOURCES = ("joints", "wrench", "scene")
MOVING = 0.005  # [m/s] of the tool, from which joints must be seen to move; our own choice


@dataclass(frozen=True)
class SafetyLimits:
    """When a robot is stopped or slowed. All our own choice.

    Attributes:
        period: Between messages of wrench and scene [s].
        joint_period: Between those of joints [s].
        patience: How much longer than a period nothing may come [s].
        pause: The same, while a robot has said that it does not move [s].
        delay: How old a message may be when it comes [s].
        frozen: How long joints may be told to the last bit alike once the tool is told to move [s].
        jump: How far a joint may be from where it can be after its greatest speed [rad or m].
        force: On the tool [N].
        speed: Of the tool, far from people [m/s].
        near_speed: The same, touching them [m/s].
        near: Distance from people below which speed falls evenly to that [m].
        workspace: Lowest and highest corner of where the tool may be [m], in the frame of commands.
        think: How long a policy may take [s].
    """

    period: float = 0.1
    joint_period: float = 0.01
    patience: float = 0.08
    pause: float = 10.0
    delay: float = 0.15
    frozen: float = 0.08
    jump: float = 0.05
    force: float = 30.0
    speed: float = 0.25
    near_speed: float = 0.08
    near: float = 0.15
    workspace: Box | None = None
    think: float = 0.08

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if name != "workspace" and not value > 0:
                raise ConfigError(f"{name} of a safety layer must be positive, got {value}")


class Guard:
    """Watches all that comes from a robot and all that a policy tells it.

    Attributes:
        limits: When it stops the robot.
        fault: Why the robot is stopped, until `release`; empty if it is not.
        on_stop: Called with the reason, once, when it stops.
    """

    def __init__(
        self,
        limits: SafetyLimits,
        joints: Sequence[str],
        fastest: Array,
        on_stop: Callable[[str], None] = lambda _: None,
    ) -> None:
        """Take the joints that must be told, and their greatest speeds [rad/s or m/s], shape [n]."""
        self.limits, self.fault, self.on_stop = limits, "", on_stop
        self._joints, self._fastest = tuple(joints), fastest
        self.release()

    def release(self, since: float = -np.inf) -> None:
        """Let the robot move again; everything must be told anew first.

        Args:
            since: What is older than that is not heeded, by its stamp [s].
        """
        self.fault, self._since = "", since
        self._paused: float | None = None
        self._came: dict[str, float] = {}
        self._stamps: dict[str, float] = {}
        self._positions: Array | None = None
        self._changed = 0.0  # when the joints were told elsewhere than before [s]
        self._told_to_move: float | None = None  # since when [s]

    def pause(self, now: float) -> None:
        """Take note that the robot says that it does not move, as while its scene is set up anew.

        Nothing is told to it and nothing that it tells is heeded until `release`. A stop stays one.
        """
        self._came.clear()
        self._paused = now

    @property
    def is_paused(self) -> bool:
        """Whether the robot has said that it does not move."""
        return self._paused is not None

    @property
    def is_ready(self) -> bool:
        """Whether all sources have spoken, and nothing is wrong."""
        return not (self.fault or self.is_paused) and all(
            source in self._came for source in SOURCES
        )

    def stop(self, reason: str) -> None:
        """Stop for a reason; the first one stands until `release`."""
        if not self.fault:
            self.fault = reason
            self.on_stop(reason)

    def check(self, now: float) -> str:
        """Return why the robot must not move at `now`; empty if it may. Call it often."""
        limits = self.limits
        if self._paused is not None and now - self._paused > limits.pause:
            self.stop(f"paused for {now - self._paused:.0f} s")
        for source, came in self._came.items():
            silence = now - came
            period = limits.joint_period if source == "joints" else limits.period
            if silence > period + limits.patience:
                self.stop(f"{source}: nothing for {1e3 * silence:.0f} ms")
        return self.fault

    def _take(self, source: str, stamp: float, now: float, values: Array, size: int) -> bool:
        """Take note of a message; whether it is sound."""
        self.check(now)
        if self.is_paused or stamp < self._since:
            return False
        age = now - stamp
        before = self._stamps.get(source)
        if values.shape != (size,):
            self.stop(f"{source}: {values.size} values, not {size}")
        elif not np.isfinite(values).all():
            self.stop(f"{source}: not a number, or infinite")
        elif age > self.limits.delay:
            self.stop(f"{source}: {1e3 * age:.0f} ms late")
        elif age < -self.limits.delay:
            self.stop(f"{source}: {-1e3 * age:.0f} ms from the future: clocks differ")
        elif before is not None and stamp == before:
            self.stop(f"{source}: the same message twice")
        elif before is not None and stamp < before:
            self.stop(
                f"{source}: messages are swapped: one is {1e3 * (before - stamp):.0f} ms older"
            )
        else:
            self._came[source] = now
            self._stamps[source] = stamp
        return not self.fault

    def joints(
        self, stamp: float, now: float, names: Sequence[str], positions: Array, velocities: Array
    ) -> None:
        """Take the joints' positions [rad or m] and velocities, in any order, each of shape [n]."""
        missing = [name for name in self._joints if name not in names]
        if missing or len(set(names)) != len(names):
            self.stop(
                f"joints: {', '.join(missing) or 'a name twice'} missing of {len(names)} names"
            )
            return
        if len(positions) != len(names) or len(velocities) != len(names):
            self.stop(f"joints: {len(positions)} positions for {len(names)} names")
            return
        order = [list(names).index(name) for name in self._joints]
        here, rates = np.asarray(positions)[order], np.asarray(velocities)[order]
        before, last = self._positions, self._stamps.get("joints")
        count = 2 * len(order)
        if not self._take("joints", stamp, now, np.concatenate((here, rates)), count):
            return
        if before is not None and last is not None:
            way = np.abs(here - before)
            way = np.minimum(
                way, np.abs(way - 2 * np.pi)
            )  # continuous joints are told modulo a turn
            far = way > self._fastest * (stamp - last) + self.limits.jump
            if far.any():
                name = self._joints[int(np.argmax(far))]
                self.stop(f"joints: {name} jumped by {way[np.argmax(far)]:.2f}")
        if before is None or (here != before).any():
            self._changed = now
        elif self._told_to_move is not None:
            alike = now - max(self._changed, self._told_to_move)
            if alike > self.limits.frozen:
                self.stop(f"joints: frozen for {1e3 * alike:.0f} ms while the tool is told to move")
        self._positions = here

    def wrench(self, stamp: float, now: float, values: Array) -> None:
        """Take force [N] and torque [N·m] on the tool, shape [6]."""
        if self._take("wrench", stamp, now, values, 6):
            force = float(np.linalg.norm(values[:3]))
            if force > self.limits.force:
                self.stop(f"wrench: {force:.0f} N on the tool, at most {self.limits.force:g} N")

    def scene(self, stamp: float, now: float, values: Array, tool: Array) -> None:
        """Take note that the scene was told: all its numbers, of any count, and the tool's place [m]."""
        if self._take("scene", stamp, now, np.ravel(values), np.size(values)):
            space = self.limits.workspace
            if space is not None and not ((space[0] <= tool) & (tool <= space[1])).all():
                self.stop(f"the tool is at {np.round(tool, 2).tolist()}, out of its workspace")

    def permit(self, twist: Array, now: float, *, gap: float, took: float = 0.0) -> Array:
        """Return what the robot is told in place of a policy's twist, shape [6]; zero once stopped.

        Args:
            twist: How the policy moves the tool [m/s] and [rad/s].
            now: The time.
            gap: Least distance of robot or tool from a person [m].
            took: How long the policy thought [s].
        """
        self.check(now)
        if twist.shape != (6,) or not np.isfinite(twist).all():
            self.stop(f"policy: {twist.tolist()} is no twist")
        elif took > self.limits.think:
            self.stop(f"policy: took {1e3 * took:.0f} ms")
        if not self.is_ready:
            self._told_to_move = None
            return np.zeros(6)
        share = min(max(gap, 0.0) / self.limits.near, 1.0)
        most = self.limits.near_speed + share * (self.limits.speed - self.limits.near_speed)
        speed = float(np.linalg.norm(twist[:3]))
        out: npt.NDArray[np.float64] = twist * min(1.0, most / max(speed, 1e-9))
        if min(speed, most) < MOVING:
            self._told_to_move = None
        elif self._told_to_move is None:
            self._told_to_move = now
        return out
