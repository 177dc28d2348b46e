"""What perturbs an environment: bodies at reset, robots' actions and what robots observe in each step."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from rcare_marl.agents.agent import Agent, Array
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.joint_group import JointGroup
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.engines.dynamics import Dynamics, grip
from rcare_marl.errors import ConfigError
from rcare_marl.observable import Observable, Observation
from rcare_marl.pose import Pose, about_z, quaternion_from_rpy, rotate
from rcare_marl.rendering.shot import Light
from rcare_marl.world import World

from .randomise import Randomisation, label, stream

BODIES = ("robot_mass", "person_mass", "object_mass", "friction")
PICTURES = ("camera_place", "light", "light_turn")
SEEN = ("observation_noise", "observation_bias", "joint_noise", "drop_out")
# [s] for which chance leads a hand astray, and with how much of its greatest speeds; our own choices.
LED_FOR, LED_MOST = 0.6, 0.3
UNMOVED = ("joint_velocity", "joint_torque")  # modes whose motors know no position
Floats = npt.NDArray[np.float32]
Start = tuple[Pose, tuple[Pose, Array] | None]  # base of a robot; tool and posture of its main arm


def _is_speed(name: str) -> bool:
    """Return whether a value of an action, such as `tool x [m/s]`, is one."""
    return name.endswith("/s]")


class BlurredObservation(Observation):
    """What a robot observes with noise, bias and drop-outs; the same however often it is read.

    Arrays, such as pictures, stay as they are, and so do the numbers of sensors, which have noise of
    their own.
    """

    def __init__(self, groups: Sequence[Sequence[Observable]]) -> None:
        """Take what it senses of itself, what the task tells, and what its sensors measure."""
        super().__init__([observable for group in groups for observable in group])
        told = {observable.name for observable in groups[1]}
        own = {observable.name for observable in groups[0]}
        self._told = [(part, unit) for part, name, unit in self.table() if name in told]
        self._own = [(part, unit) for part, name, unit in self.table() if name in own]
        self._shown: Floats | None = None

    def begin(self, role: str, seed: int, drawn: Mapping[tuple[str, str], float]) -> None:
        """Begin an episode with the values that were drawn for it."""
        sizes = {name: {u: v for (n, u), v in drawn.items() if n == name} for name in SEEN}
        self._bias = self._sizes(self._told, sizes["observation_bias"])
        self._bias *= stream(seed, f"{role}/bias").standard_normal(self.size)
        self._noise = self._sizes(self._told, sizes["observation_noise"])
        self._noise += self._sizes(self._own, sizes["joint_noise"])
        self._share = sizes["drop_out"].get("share", 0.0)
        self._chance, self._drops = stream(seed, f"{role}/noise"), stream(seed, f"{role}/drops")
        self._shown = None

    def _sizes(self, parts: Iterable[tuple[slice, str]], by_unit: Mapping[str, float]) -> Array:
        """Return the number of each observed value's unit, shape [size]; of `rad or m` that of `rad`."""
        out = np.zeros(self.size)
        for part, unit in parts:
            units = sorted(unit.split(" or "), reverse=True)  # rad before m
            out[part] = next((by_unit[each] for each in units if each in by_unit), 0.0)
        return out

    def look(self) -> None:
        """Take note of what is seen in this control step."""
        noise = self._noise * self._chance.standard_normal(self.size)
        is_lost = self._drops.random() < self._share and self._shown is not None
        if not is_lost:
            self._shown = (super().vector() + self._bias + noise).astype(np.float32)

    def vector(self) -> Floats:
        return super().vector() if self._shown is None else self._shown.copy()


class Randomiser:
    """Draws the perturbations of each episode from its seed and lets an environment have them.

    Attributes:
        randomisation: The perturbations.
        drawn: Their values in the running episode by name and unit.
    """

    def __init__(self, randomisation: Randomisation) -> None:
        """Take the perturbations, perhaps none."""
        self.randomisation = randomisation
        self.drawn: dict[tuple[str, str], float] = {}
        self._names = {name for name, _ in randomisation.spreads}
        self._dynamics: Dynamics | None = None
        self._robots: dict[str, Robot] = {}
        self._seen: dict[str, BlurredObservation] = {}
        self._waiting: dict[str, list[Array]] = {}
        self._obeyed: dict[str, Array] = {}
        self._chances: dict[str, np.random.Generator] = {}
        self._led: dict[str, tuple[int, Array]] = {}  # how many steps are left, and where
        self._starts: dict[str, Start] = {}  # of those that `robot_place` moves

    def bind(self, world: World, cast: Mapping[str, Agent]) -> None:
        """Take hold of a scene whose world is marked, in place of any scene before.

        Raises:
            ConfigError: If a perturbation does nothing to a robot of the cast.
        """
        self._robots = {role: a for role, a in cast.items() if isinstance(a, Robot)}
        self._cast, self._world, self._seen = cast, world, {}
        if "motor_gain" in self._names:
            for role, robot in self._robots.items():
                mode = robot.describe()["control"]
                if mode in UNMOVED:
                    raise ConfigError(
                        f"motor_gain does nothing to {role!r} under {mode!r}, whose motors know no "
                        "position: use motor_strength or motor_lag"
                    )
        if "led_astray" in self._names:
            for role, robot in self._robots.items():
                if not any(_is_speed(name) for name in robot.action_names):
                    raise ConfigError(
                        f"led_astray does nothing to {role!r} under {robot.describe()['control']!r}, which "
                        "is told no speeds: use tool_delta, impedance, admittance or joint_velocity"
                    )
        self._starts = {}
        for role, robot in self._robots.items() if "robot_place" in self._names else ():
            if robot.rides:
                raise ConfigError(f"robot_place cannot move {role!r}, which rides on a wheelchair")
            hand = (robot.tool_pose(), robot.arm.rest.copy()) if robot.arms else None
            self._starts[role] = robot.body.base_pose(), hand
        if asked := sorted(self._names & set(PICTURES)):
            if not any([self._expose(role, Pose(), Light()) for role in self._robots]):
                raise ConfigError(
                    f"{asked[0]} does nothing: no robot has a camera; give one to it as in "
                    "robot={'sensors': ['camera']}"
                )
        if self._names & set(BODIES):
            self._dynamics = Dynamics(world, [robot.body for robot in self._robots.values()])

    def observation(self, role: str, *groups: Sequence[Observable]) -> Observation:
        """Return what a role observes.

        Args:
            role: The role.
            *groups: What it senses of itself, what the task tells, and what its sensors measure.
        """
        if role in self._robots and self._names & set(SEEN):
            self._seen[role] = BlurredObservation(groups)
            return self._seen[role]
        return Observation([observable for group in groups for observable in group])

    def begin(self, seed: int, spread: float) -> None:
        """Draw the values of an episode, before the world is rewound; see `Randomisation.draw`."""
        self.drawn = self.randomisation.draw(seed, spread)
        if self._dynamics is not None:
            self._scale(self._dynamics)
        for role, robot in self._robots.items():
            for part in robot.parts.values():
                if isinstance(part.joints, JointGroup):
                    part.joints.motor_gain = self._value("motor_gain", 1.0)
                    part.joints.motor_strength = self._value("motor_strength", 1.0)
            if role in self._seen:
                self._seen[role].begin(role, seed, self.drawn)
            if self._names & set(PICTURES):
                self._misplace_cameras(role, seed)
        self._places = {role: stream(seed, f"{role}/place") for role in self._robots}
        self._waiting = {role: [] for role in self._robots}
        self._obeyed, self._led = {}, {}
        self._chances = {role: stream(seed, f"{role}/led_astray") for role in self._robots}

    def rewind(self) -> None:
        """Rewind the world, with robots beside their places, each time elsewhere.

        The tool of the main arm begins where it does else, as far as the arm can, and holds what it held.
        """
        self._world.rewind()
        shift, turn = (self._value("robot_place", unit=unit) for unit in ("m", "rad"))
        is_moved = shift > 0 or turn > 0
        for role, (base, hand) in self._starts.items():
            robot = self._robots[role]
            x, y, yaw = self._places[role].standard_normal(3) * (shift, shift, turn)
            turned = Pose((x, y, 0.0), about_z(yaw)) @ Pose(quaternion=base.quaternion)
            robot.place(Pose(tuple(np.add(base.position, turned.position)), turned.quaternion))
            if hand is not None:
                tool, robot.arm.rest = hand  # the last episode's would lead the search
                if is_moved:
                    found = robot.solve_ik(tool, seed=robot.arm.rest, near=True)
                    robot.arm.rest = found.posture

    def _misplace_cameras(self, role: str, seed: int) -> None:
        at, turn = stream(seed, f"{role}/camera").standard_normal((2, 3))
        at *= self._value("camera_place", unit="m")
        turn *= self._value("camera_place", unit="rad")
        swing = self._value("light_turn") * stream(seed, "light").standard_normal(3)
        error = Pose(tuple(at.tolist()), tuple(quaternion_from_rpy(*turn).tolist()))
        way, power = rotate(quaternion_from_rpy(*swing), Light.direction), self._value("light", 1.0)
        self._expose(role, error, Light(tuple(way.tolist()), key=power, fill=power))

    def _expose(self, role: str, error: Pose, light: Light) -> bool:
        """Misplace the cameras of a robot, and light what they see; return whether it has any."""
        sensors = self._robots[role].sensors
        found = sensors.sensors.values() if sensors is not None else ()
        return any([sensor.misplace(error, light) for sensor in found])

    def _value(self, name: str, usual: float = 0.0, unit: str = "") -> float:
        found = (v for (n, u), v in self.drawn.items() if n == name and unit in ("", u))
        return next(found, usual)

    def _scale(self, dynamics: Dynamics) -> None:
        kinds = {agent.body.uid: type(agent) for agent in self._cast.values()}
        friction = grip(self._value("friction", 1.0))
        for body in self._world.bodies:
            kind = kinds.get(body.uid)
            name = "object_mass" if kind is None else "robot_mass"
            if kind is not None and issubclass(kind, Human):
                name = "person_mass"
            dynamics.scale(body, mass=self._value(name, 1.0), friction=friction)

    def passed_on(self, commands: Mapping[str, Array], control_dt: float) -> Mapping[str, Array]:
        """Return what agents are told of their actions now, which may be late, slow, or led astray.

        A robot that nothing has reached yet is told nothing, and holds its start. A lag begins with the
        first action that comes.
        """
        told = self._held_back(commands, control_dt)
        share = self._value("led_astray")
        if share == 0.0:
            return told
        steps = max(round(LED_FOR / control_dt), 1)
        return {
            role: self._led_astray(role, action, share, steps) if role in self._robots else action
            for role, action in told.items()
        }

    def _led_astray(self, role: str, action: Array, share: float, steps: int) -> Array:
        """Return a robot's action, or for some steps chance's speeds in it; grippers do as they are told."""
        left, way = self._led.get(role, (0, action))
        if left == 0 and self._chances[role].random() < share:
            left, way = steps, self._chances[role].uniform(-LED_MOST, LED_MOST, action.shape)
        self._led[role] = max(left - 1, 0), way
        if left == 0:
            return action
        are_speeds = [_is_speed(name) for name in self._robots[role].action_names]
        return np.where(are_speeds, way, action).astype(action.dtype)

    def _held_back(self, commands: Mapping[str, Array], control_dt: float) -> Mapping[str, Array]:
        delay, lag = int(self._value("action_delay")), self._value("motor_lag")
        if not self._robots or (delay == 0 and lag == 0.0):
            return commands
        share = 1.0 if lag == 0.0 else 1.0 - math.exp(-control_dt / lag)
        out: dict[str, Array] = {}
        for role, action in commands.items():
            if role not in self._robots:
                out[role] = action
                continue
            queue = self._waiting[role]
            queue.append(action)
            if len(queue) > delay:
                wanted = queue.pop(0)
                before = self._obeyed.get(role, wanted)
                out[role] = self._obeyed[role] = before + share * (wanted - before)
        return {role: out[role] for role in self._cast if role in out}

    def look(self) -> None:
        """Let robots see what there is in this control step."""
        for seen in self._seen.values():
            seen.look()

    def numbers(self) -> dict[str, float]:
        """Return the values of the running episode by `randomise_<name>`, with the unit of noise and bias."""
        return {label(*key): value for key, value in self.drawn.items()}
