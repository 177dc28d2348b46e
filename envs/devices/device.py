"""A device: one body made from data, with named frames and joints that are worked by name or stick."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from numbers import Real
from pathlib import Path

from rcare_marl.agents.people.human import Human
from rcare_marl.attachment import Attachment
from rcare_marl.body import Body
from rcare_marl.bullet import bullet
from rcare_marl.contact import Contact
from rcare_marl.errors import ActionError, ConfigError, WorldError, check_name
from rcare_marl.model.urdf import write
from rcare_marl.pose import Pose
from rcare_marl.world import World

from .device_model import DeviceControl, DeviceModel, Frame, load_device

SLIP = 1e-3  # how far a joint gives before it slips [rad or m]; our own choice
_GAIN = 0.1  # share of that which the motor takes back in one physics step
HOLD = 5000.0  # [N], of the bond between a person and what carries them; own choice
_ROUNDING = 1e-4  # of limits and targets, and of joints that are pressed against a limit [rad or m]


class DryFriction:
    """Coulomb friction in joints, with a memory of where each sticks.

    A motor that is told to stand still has none: the solver stops before it has found all forces, and
    what is left moves a laden joint on in each step. This one pursues a place, by its friction at most,
    and a joint that is pulled further takes the place along: an elastoplastic model of friction with
    one state a joint. Implements `rcare_marl.world.SteppedMatter`.
    """

    def __init__(self, world: World, body: Body) -> None:
        """Take up work in a world; nothing sticks until `hold`."""
        self._body = body
        self._forces: dict[int, float] = {}
        self._places: dict[int, float] = {}
        self._marked: tuple[dict[int, float], dict[int, float]] = ({}, {})
        world.matter.append(self)

    def hold(self, forces: Mapping[int, float]) -> None:
        """Let joints, by index, stick where they stand with at most these forces [N or N·m]."""
        joints = list(forces)
        self._forces.update(forces)
        self._places.update(zip(joints, self._body.joint_states(joints)[0], strict=True))
        self._send(joints)

    def let_go(self, joints: Iterable[int]) -> None:
        """Leave joints to whoever drives them from now on."""
        for joint in joints:
            self._forces.pop(joint, None)
            self._places.pop(joint, None)

    def step(self) -> None:
        """Take along the places of joints that slip."""
        places = self._places
        if not places:
            return
        slipped = []
        positions = self._body.joint_states(list(places))[0]
        for (joint, place), position in zip(places.items(), positions, strict=True):
            if abs(position - place) > SLIP:
                slipped.append(joint)
                places[joint] = position + (SLIP if place > position else -SLIP)
        if slipped:
            self._send(slipped)

    def contacts(self, a: Body, b: Body | None = None) -> list[Contact]:
        """Return nothing: it touches nobody."""
        return []

    def mark(self) -> None:
        """Remember where joints stick."""
        self._marked = (dict(self._forces), dict(self._places))

    def rewind(self) -> None:
        """Let joints stick where they did: motors do not return with a snapshot."""
        self._forces, self._places = (dict(kept) for kept in self._marked)
        self._send(list(self._places))

    def _send(self, joints: list[int]) -> None:
        if joints:
            places, forces = ([kept[j] for j in joints] for kept in (self._places, self._forces))
            self._body.drive_positions(joints, places, forces, position_gain=_GAIN)


def grip(world: World, body: Body, links: Iterable[int], *, friction: float) -> None:
    """Give links a coefficient of friction, and let what they stand on hold them without creeping.

    Bullet then remembers where a contact began, and takes back what it slid while it should stick.
    """
    for link in links:
        bullet.changeDynamics(
            body.uid,
            link,
            lateralFriction=friction,
            frictionAnchor=1,
            physicsClientId=world.client,
        )


class Device:
    """A body made from data: a YAML file has all that it is.

    Its frames go with its links. Its controls are worked by name: `command` drives one to a place, `stop`
    holds it, `position` tells where it stands, `limits` how far it goes, and `set_position` puts it there
    at once.

    Attributes:
        model: Links, joints, frames, controls and contacts; it may be changed before `spawn`.
    """

    _body: Body | None = None
    _bond: Attachment | None = None

    def __init__(
        self, source: str | Path | DeviceModel, *, fixed: Mapping[str, float] | None = None
    ) -> None:
        """Make a device.

        Args:
            source: A name in `assets/devices`, a YAML file, or a model.
            fixed: Joints that stand still for good, and where [rad or m].

        Raises:
            UnknownNameError: If there is no such device or joint, or its file has an unknown key.
            ConfigError: If a value in its file is missing or impossible, or a joint does not go so far.
        """
        self.model = source if isinstance(source, DeviceModel) else load_device(source)
        self._set = dict(fixed or {})
        for name, position in self._set.items():
            check_name(f"joint of {self.model.name}", name, self.model.joints)
            joint = self.model.joints[name]
            if not joint.lower <= position <= joint.upper:
                raise ConfigError(
                    f"{name!r} of {self.model.name!r} goes from {joint.lower:.4g} to"
                    f" {joint.upper:.4g}, not to {position}"
                )

    @property
    def body(self) -> Body:
        """Its body; WorldError before `spawn`."""
        return self._need_body()

    def _need_body(self) -> Body:
        if self._body is None:
            raise WorldError(f"this {type(self).__name__} is in no world yet: spawn it first")
        return self._body

    @property
    def frames(self) -> Mapping[str, Frame]:
        """Named places on it."""
        return self.model.frames

    @property
    def controls(self) -> Mapping[str, DeviceControl]:
        """What can be worked by `command`; all other joints move freely, within their friction."""
        return self.model.controls

    @property
    def postures(self) -> Mapping[str, tuple[str, str]]:
        """How people rest in it: posture, frame."""
        return self.model.postures

    @property
    def pose(self) -> Pose:
        """The present pose of the device in the world."""
        return self.body.base_pose()

    def frame(self, name: str) -> Pose:
        """Return a named frame in the device with its joints at zero; UnknownNameError if there is none."""
        if self._body is not None and name in self._frame_poses:
            return self._frame_poses[name]
        check_name("frame", name, self.frames)
        frame = self.frames[name]
        pose, link = frame.pose, frame.link or self.model.root
        if self._set:
            at_zero = self.model.link_pose(link)
            pose = self.model.link_pose(link, self._set) @ at_zero.inverse() @ pose
        if self._body is not None:  # its sizes do not change any more
            self._frame_poses[name] = pose
        return pose

    def frame_in_world(self, name: str) -> Pose:
        """Return the present pose of a named frame in the world."""
        link = self._carriers.get(name) if self._body is not None else None
        if link is None:
            return self.pose @ self.frame(name)
        there = self.body.link_pose(self.body.link_index(link))
        return there @ self._to_base[link] @ self.frame(name)

    def spawn(self, world: World, pose: Pose = Pose(), *, name: str = "") -> Body:
        """Load it into `world` at `pose`, once, and return its body; WorldError the second time."""
        if self._body is not None:
            raise WorldError(f"{self._body.name!r} was spawned already: make another device")
        model = self.model
        # Fixed joints cost nothing where their links melt into those that carry them.
        path = write(model, melt_except=tuple(model.contact), fixed_joints=self._set)
        body = world.load_urdf(path, pose, name=name or model.name, fixed=not model.is_movable)
        self._body, self._world = body, world
        self._frame_poses: dict[str, Pose] = {}
        # All joints stand at zero now.
        carriers = {key: self._moving(f.link or model.root) for key, f in self.frames.items()}
        self._carriers = {key: link for key, link in carriers.items() if link != model.root}
        base = body.base_pose().inverse()
        self._to_base = {
            link: (base @ body.link_pose(body.link_index(link))).inverse()
            for link in set(self._carriers.values())
        }
        for joint, moving in body.joints.items():
            body.release_motors([moving.index], model.joints[joint].friction)
        self._apply_contacts(world, body)
        if model.sticking:
            forces = {body.joint(j).index: model.joints[j].friction for j in model.sticking}
            DryFriction(world, body).hold(forces)
        self.reset()
        return body

    def _moving(self, link: str) -> str:
        """Return the link that one is part of, after those behind fixed joints have melted."""
        carriers = {joint.child: joint.parent for joint in self.model.joints.values()}
        while link not in self.body.links:
            link = carriers[link]
        return link

    def _apply_contacts(self, world: World, body: Body) -> None:
        for link, touch in self.model.contact.items():
            index = body.link_index(link)
            if touch.friction is not None and touch.grips:
                grip(world, body, [index], friction=touch.friction)
            elif touch.friction is not None:
                body.set_friction([index], lateral=touch.friction)
            if touch.stiffness is not None and touch.damping is not None:
                body.set_softness(stiffness=touch.stiffness, damping=touch.damping, links=[index])

    def reset(self) -> None:
        """Hold what is controlled where it stands: motor targets do not return with a snapshot."""
        for name in self.controls:
            self.stop(name)

    def command(self, name: str, target: float) -> None:
        """Drive a control to `target` [rad or m] at its speed at most.

        Raises:
            UnknownNameError: If there is no such control.
            ActionError: If `target` is not a number within its limits.
            WorldError: If the device is in no world.
        """
        self._check(name, target)
        self._drive(name, target)

    def _drive(self, name: str, target: float) -> None:
        control = self._control(name)
        joint = self.body.joint(control.joint)
        self.body.wake()
        place = min(max(float(target), joint.lower), joint.upper)
        self.body.drive_to([joint.index], [place], [control.speed], [control.force], [1.0])

    def stop(self, name: str) -> None:
        """Hold a control where it stands; UnknownNameError if there is none of that name."""
        self._drive(name, self.position(name))

    def position(self, name: str) -> float:
        """Return where a control stands [rad or m]; UnknownNameError if there is none."""
        index = self.body.joint(self._control(name).joint).index
        return self.body.joint_states([index])[0][0]

    def set_position(self, name: str, position: float) -> None:
        """Put a control at `position` [rad or m] at once and hold it there; raises as `command`."""
        self._check(name, position)
        joint = self.body.joint(self._control(name).joint)
        self.body.set_joints([joint.index], [min(max(position, joint.lower), joint.upper)])
        self.stop(name)

    def limits(self, name: str) -> tuple[float, float]:
        """Return how far a control goes, least and most [rad or m]; raises as `position`."""
        joint = self.body.joint(self._control(name).joint)
        return joint.lower, joint.upper

    def _check(self, name: str, target: float) -> None:
        low, high = self.limits(name)
        if not isinstance(target, Real) or not math.isfinite(target):
            raise ActionError(
                f"{name!r} of {self.body.name!r} needs a finite number, got {target!r}"
            )
        if not low - _ROUNDING <= target <= high + _ROUNDING:
            unit = "m" if self.body.joint(self._control(name).joint).kind == "prismatic" else "rad"
            raise ActionError(
                f"{name!r} of {self.body.name!r} goes from {low:.4g} to {high:.4g} {unit}, not to"
                f" {target:.4g}"
            )

    def _control(self, name: str) -> DeviceControl:
        check_name("control", name, self.controls)
        return self.controls[name]

    def carry(self, person: Human, frame: str = "") -> Attachment:
        """Bond a person to what bears them, as by a belt, and return the bond.

        They pass through the device from then on.

        Args:
            person: Who rests on it already; spawned with `fixed_base=False`.
            frame: The frame that they rest on; that of the first of `postures` if empty.

        Raises:
            ConfigError: If the person's pelvis is held in place, or nobody rests in the device.
            UnknownNameError: If there is no such frame.
            WorldError: If somebody is carried already, the device is in no world, or the solver of
                the world works with fewer iterations than the device asks for.
        """
        self._need_body()
        if not self.postures:
            raise ConfigError(f"nobody rests in {self.body.name!r}")
        if not person.body.is_movable:
            raise ConfigError(
                f"{self.body.name!r} can carry {person.name!r} only with fixed_base=False"
            )
        frame = frame or next(iter(self.postures.values()))[1]
        self.frame(frame)
        if self._bond is not None and self._bond.is_active:
            raise WorldError(f"{self._bond.child.name!r} rests there already: release them first")
        least = self.model.least_iterations
        if self._world.solver_iterations < least:
            raise WorldError(
                f"{self.body.name!r} with a person needs {least} iterations of the solver, got"
                f" {self._world.solver_iterations}: call world.set_solver_iterations({least})"
            )
        person.ignore(self.body)
        link = self._carriers.get(frame, "base")
        self._bond = self._world.attach(self.body, link, person.body, force=HOLD)
        return self._bond

    def release(self) -> None:
        """Let go of who is carried; nothing happens if nobody is. They still pass through it."""
        self._need_body()
        if self._bond is not None:
            self._world.detach(self._bond)
        self._bond = None
