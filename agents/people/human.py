"""People: one class, one YAML file for each avatar; how they move and who decides are parts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rcare_marl.body import OWN_GROUPS, Body
from rcare_marl.cache import cached
from rcare_marl.errors import ConfigError, UnknownNameError, check_name
from rcare_marl.observable import Observable
from rcare_marl.pose import Pose, conjugate, quaternion_from_matrix, rotate
from rcare_marl.soft.soft_body import SoftBody
from rcare_marl.soft.soft_world import SoftWorld
from rcare_marl.world import GRAVITY, World

from ..agent import Agent, Array
from .actuation.actuation import Actuation
from .actuation.drive import ActuationConfig, make_drive
from .avatar import AvatarConfig, body_model, body_segments, expand_movable, person_urdf, seated
from .body.end_stops import EndStops
from .body.person_tree import person_tree
from .body.posture import PostureConfig, lay_arm, pelvis_pose, soles
from .body.segment import nearest, shape_row
from .body.self_contact import clear_arms, meeting_links
from .body.skeleton import DOF_INDEX, DOFS, JOINT_INDEX, JOINTS, SIDES
from .body.skin import JointFrame, PersonSkin
from .body.tissue import Tissue, attach_tissue, expand_tissue
from .hand import Hand
from .load import LoadMeter
from .motion.legs import Legs
from .moves import Moves, expand_moves
from .physiology import Physiology
from .physiology_model import REGIONS, physiology_model
from .resting.dose import PressureDose
from .resting.support import Support

FRICTION = 0.6  # skin and clothes against plastic and metal; our own choice


class Human(Agent):
    """A person whose abilities come from an avatar.

    Attributes:
        avatar: Who it is.
        posture: How the person starts.
        actuation: How the joints are driven.
        movable: The DoFs that move, proximal first; all others are fixed in the posture.
        active: Active limits of the movable DoFs [rad], shape [n, 2].
        passive: Their passive limits [rad], shape [n, 2].
        positions: Angles of the movable DoFs at the end of the last control step [rad].
        velocities: Their rates then [rad/s].
        physiology: Vital signs, fatigue, pain and comfort.
        tissue: Flesh that yields, if any.
        pressure_dose: Pressure over time on the skin of who rests, see `rest_on`.
        supports: Bodies that can move and carry the person: to rest on them is no pressure.
        pelvis: Where the pelvis was put, in the world; where a held pelvis is.
        moves: What actions do beside moving the joints: `walk`, `kneel`, `grasp`, `speak`.
    """

    def __init__(
        self,
        name: str,
        avatar: AvatarConfig,
        *,
        posture: PostureConfig,
        movable: Sequence[str] | None = None,
        fixed_base: bool = True,
        actuation: ActuationConfig | None = None,
        tissue: Sequence[str] = (),
        physiology_observed: bool = False,
        moves: Sequence[str] = (),
    ) -> None:
        """Prepare a person.

        Args:
            name: The role.
            avatar: Who it is.
            posture: How the person starts.
            movable: DoFs, or joints for all DoFs of a joint, that move; all 112 if None.
            fixed_base: Whether the pelvis is held in place, as by a lap belt.
            actuation: How the joints are driven; `skeletal` if None.
            tissue: Segments whose flesh yields, as in `body.tissue.expand_tissue`.
            physiology_observed: Whether the person observes their own physiology.
            moves: What actions do beside moving the joints: `walk`, `kneel`, `grasp`, `speak`. Legs
                that walk or kneel have no action values of their own.

        Raises:
            UnknownNameError: If there is no such DoF, joint, tissue or move.
            ConfigError: If somebody who moves so acts by excitations.
        """
        self.moves = expand_moves(moves)
        self.physiology = Physiology(avatar)
        self.supports: list[Body] = []
        self.pressure_dose = PressureDose()
        self._borne_by: Support | None = None
        self._physiology_observed = physiology_observed
        self._is_tired = False
        self.name, self.avatar, self.posture = name, avatar, posture.borne(avatar.bearing)
        self.movable = expand_movable(movable)
        self._fixed_base = fixed_base
        self.actuation = actuation or ActuationConfig()
        by_muscle = self.actuation.kind == "muscle"
        is_excited = by_muscle and self.actuation.excitation in ("unit", "group")
        if self.moves and is_excited:
            raise ConfigError(
                f"{name!r} is to {', '.join(self.moves)}, which takes action values from -1 on: with "
                "actuation 'muscle' choose the excitation 'posture', or an empty list of moves"
            )
        self._soft = expand_tissue(tissue)
        self._arm_rests: dict[str, Pose] = {}
        order = [DOF_INDEX[dof] for dof in self.movable]
        limits = [avatar.profile.limits(kind) for kind in ("active", "passive")]
        self.active, self.passive = (
            np.array([lim[dof] for dof in self.movable]).reshape(-1, 2) for lim in limits
        )
        self._order = order
        self._index = {dof: i for i, dof in enumerate(self.movable)}

    @property
    def action_size(self) -> int:
        return len(self.action_names)

    @property
    def action_low(self) -> float:
        return self.drive.action_low

    @property
    def action_names(self) -> tuple[str, ...]:
        return self._moves.action_names

    @property
    def entries(self) -> Mapping[str, slice]:
        """Where the values of each of the `moves` are in an action."""
        return self._moves.entries

    @property
    def legs(self) -> Legs | None:
        """What walks and kneels; None where neither is among the `moves`."""
        return self._moves.legs

    @property
    def hands(self) -> Mapping[str, Hand]:
        """What grasps, by side: each hand whose arm can move, if `grasp` is among the `moves`."""
        return self._moves.hands

    @property
    def says_no(self) -> bool:
        """Whether the person said no in the last control step, if `speak` is among the `moves`."""
        return self._moves.says_no

    def use_arm_rests(self, left: Pose | None, right: Pose | None) -> None:
        """Say where armrests are, before `spawn`: middle of a pad's top, x along it to the front."""
        pads = {"left": left, "right": right}
        self._arm_rests = {side: pad for side, pad in pads.items() if pad is not None}

    def soles(self, pose: Pose) -> dict[str, Array]:
        """Return the middle of each sole, by side [m], for the posture on the support at `pose`."""
        return soles(*seated(self.avatar, self.posture, pose))

    def spawn(self, world: World, pose: Pose) -> None:
        """Load the person onto the support at `pose`; see `body.posture.pelvis_pose`."""
        avatar, path = self.avatar, self.avatar.body_path()
        self.model = body_model(path, avatar.height_m)
        self.segments = body_segments(path, avatar.height_m, avatar.mass_kg, avatar.sex)
        limits = avatar.profile.limits("passive")
        angles = self.posture.angles(limits)
        self.pelvis = self._home = pelvis_pose(self.posture, self.model, angles, pose)
        rests = self._arm_rests if self.posture.arms == "armrests" else {}
        laid = [side for side in rests if side not in self.posture.own_arms]
        for side in laid:
            angles = self._laid(side, angles, rests[side])
        free = [side for side in SIDES if side not in laid]
        angles = clear_arms(free, angles, self.segments, self.model.joints, limits)
        self.angles = angles
        urdf = person_urdf(
            avatar, "passive", movable=self.movable, posture=angles, tissue=self._soft
        )
        file = cached(avatar.name.lower().replace(" ", "_"), ".urdf", urdf.text)
        self._fixed_base = self._fixed_base and not self.rides
        meets, held = world.own_groups < OWN_GROUPS, self._fixed_base
        self.body = world.load_urdf(
            file, self.pelvis, name=self.name, fixed=held, self_collision=meets
        )
        self.body.exclude_own_links()
        self.body.set_damping()
        self.body.set_friction(range(-1, self.body.link_count), lateral=FRICTION)
        self._joints = self.joint_indices = self.body.indices(self.movable)
        self.body.release_motors(self._joints)
        self._start = angles[self._order]
        # Where a posture starts outside the active range the person cannot go further out.
        self._lowest = np.minimum(self.active[:, 0], self._start)
        self._highest = np.maximum(self.active[:, 1], self._start)
        self.body.set_joints(self._joints, self._start)
        self._stops = EndStops(self.body, self._joints, self.passive)
        self.world = world
        self.frames = [
            JointFrame(self.body.link_index(f.link), f.rotation, f.offset) for f in urdf.frames
        ]
        self._segments_on: dict[int, list[tuple[str, JointFrame]]] = {}
        self._surfaces: dict[int, tuple[list[str], Array]] = {}  # shapes by link, once asked for
        for joint, frame in zip(JOINTS, self.frames, strict=True):
            if self.segments[joint].shapes:
                self._segments_on.setdefault(frame.link, []).append((joint, frame))
        parts = {link: [joint for joint, _ in here] for link, here in self._segments_on.items()}
        puppet = {"walk", "kneel"} & set(self.moves)  # whose legs are nobody's to plan round
        self.body.let_meet(meeting_links(parts, legs=not puppet))
        self.drive = self._make_drive(world.physics_dt)
        self._moves = Moves(self, world)
        self._sensed_at = world.time
        self.sense()
        self._gravity = np.zeros(3)
        self._find_gravity()
        # A task may let everybody settle before the first episode.
        self.drive.reset(np.random.default_rng(0), self._gravity)
        region = physiology_model().region
        self._regions = [REGIONS.index(region(DOFS[i].joint)) for i in self._order]
        self._meter = LoadMeter(self, world, gravity=self._gravity, posture=self._start)
        self.physiology.reset(upright=self._meter.upright())
        self._is_tired = True  # perhaps from the last episode
        self._tire()
        skin = PersonSkin(self.model, self.body, self.frames)
        world.skins.append(skin)
        self.tissue: Tissue | None = None
        if self._soft:
            self.tissue = attach_tissue(
                world, self.body, self.model, self.frames, self._soft, skin=skin
            )
        self._face, self._jaw = (self._mouth_on(joint) for joint in ("head", "jaw"))

    def _laid(self, side: str, angles: Array, pad: Pose) -> Array:
        """Return angles of all DoFs [rad] with one arm laid on an armrest."""
        limits = self.avatar.profile.limits("passive")
        radius = self.segments[f"{side}_elbow"].shapes[0].size[1]
        return lay_arm(side, self.model, angles, self.pelvis, pad, limits, clearance=radius)

    def laid_on(self, side: str, pad: Pose) -> dict[str, float]:
        """Return the angles of movable DoFs [rad] that lay an arm on an armrest, once spawned.

        `pad` is the middle of the pad's top in the world, x along it to the front.
        """
        laid = self._laid(side, self.angles, pad)
        return {dof: float(laid[DOF_INDEX[dof]]) for dof in self.movable if dof.startswith(side)}

    def _mouth_on(self, joint: str) -> tuple[int, Array, Array]:
        """Return the link of a joint, and mouth and forward direction in the frame of that link."""
        frame = self.frames[JOINT_INDEX[joint]]
        mouth = self.model.mouth - self.model.joints[JOINT_INDEX[joint]]
        return frame.link, frame.rotation @ mouth + frame.offset, frame.rotation[:, 2]

    def _make_drive(self, physics_dt: float) -> Actuation:
        chain = person_tree(self.segments, self.model.joints, self.angles, self.movable)
        if chain.names != self.movable:
            raise ConfigError("the movable DoFs of a person must be in the order of the skeleton")
        return make_drive(
            self.avatar,
            chain,
            self.actuation,
            lying=self.posture,
            posture=self._start,
            limits=np.column_stack((self._lowest, self._highest)),
            passive=self.passive,
            physics_dt=physics_dt,
        )

    def _find_gravity(self) -> None:
        base = self.body.base_pose().quaternion if not self._fixed_base else self.pelvis.quaternion
        self._gravity[:] = rotate(conjugate(base), (0.0, 0.0, -GRAVITY))

    def reset(self, rng: np.random.Generator) -> None:
        if self.pelvis is not self._home:
            self.place(self._home)
        self.body.set_joints(self._joints, self._start)
        self.drive.reset(rng, self._gravity)
        self.pressure_dose.reset()
        self._moves.reset()
        self._sensed_at = self.world.time
        self.physiology.reset(upright=self._meter.upright())
        self._is_tired = True  # perhaps from the last episode
        self._tire()

    def set_angles(self, angles: Mapping[str, float], *, laid: bool = False) -> None:
        """Teleport movable DoFs to `angles` [rad], by name, kept inside the passive range.

        With `laid` what holds a weak limb holds it there until the next reset, in place of where the
        posture has it.
        """
        for dof, angle in angles.items():
            if dof not in self._index:
                raise UnknownNameError("movable degree of freedom", dof, self.movable)
            i = self._index[dof]
            value = float(np.clip(angle, *self.passive[i]))
            self.body.set_joints([self._joints[i]], [value])
            if laid:
                self.drive.lay(i, value)
            else:
                self.drive.target[i] = value

    def place(self, pelvis: Pose) -> None:
        """Teleport the pelvis to a pose in the world, at rest; a held pelvis is held there."""
        self.body.set_base(pelvis)
        self.pelvis = pelvis
        self._find_gravity()

    def command(self, action: Array, duration: float) -> None:
        self.drive.command(self._moves.split(action), duration)

    def action_towards(self, angles: Mapping[str, float], duration: float) -> Array:
        """Return the action that pursues `angles` [rad] of some movable DoFs, whatever drives them.

        It asks for none of the `moves`: a policy writes those into it, see `entries`.

        Args:
            angles: Wished angles by DoF [rad]; the other DoFs stay where they are held.
            duration: Length of the control step [s].

        Raises:
            UnknownNameError: If a DoF does not move.
            ConfigError: If an angle is not finite.
        """
        for dof, angle in angles.items():
            if dof not in self._index:
                raise UnknownNameError("movable degree of freedom", dof, self.movable)
            if not math.isfinite(angle):
                raise ConfigError(f"wished angle of {dof!r} must be finite, got {angle}")
        return self._moves.joined(self.drive.action_towards(angles, duration))

    def slack_action(self, duration: float) -> Array:
        """Return the action that lets limbs go where they are taken, and asks nothing of legs and hands.

        Args:
            duration: Length of the control step [s].
        """
        return self._moves.joined(self.drive.slack_action(duration))

    def actuate(self) -> None:
        if not self._joints:
            return
        if self._moves.legs is not None:
            self._moves.legs.advance()
        if not (self._fixed_base or self.rides):  # who rides stays level
            self._find_gravity()
        torques = self.drive.torques(*self._stops.joint_states(), self._gravity)
        self.body.drive_torques(self._joints, torques)

    def compiled(self) -> tuple[Any, ...] | None:
        """Return the drive's compiled part and ends of joints [rad]; None where more moves a person."""
        is_held = self._moves.legs is None and (self._fixed_base or self.rides)
        drive = self.drive.compiled(self._gravity) if is_held and self._joints else None
        return None if drive is None else (drive, np.ascontiguousarray(self._stops.ends))

    def sense(self) -> None:
        self.positions, self.velocities = self._stops.joint_states()
        passed, self._sensed_at = self.world.time - self._sensed_at, self.world.time
        if passed > 0:
            self.physiology.advance(passed, self._meter.read())
            self._tire()
            if self._borne_by is not None:
                self.pressure_dose.rest(self, self._borne_by)
            self.pressure_dose.advance(passed)

    def rest_on(self, support: Support | None) -> None:
        """Say what bears the person from now on, for `pressure_dose` alone; None while nothing does."""
        self._borne_by = support
        self.pressure_dose.rest(self, support)

    def _tire(self) -> None:
        """Let tired regions lose strength."""
        tired = self.physiology.fatigues()
        if max(tired) > 0.0 or self._is_tired:
            self._is_tired = max(tired) > 0.0
            self.drive.weaken(1.0 - np.array(tired)[self._regions])

    def joint_pose(self, joint: str) -> Pose:
        """Return the pose of an SMPL-X joint's frame in the world."""
        if joint not in JOINT_INDEX:
            raise UnknownNameError("joint", joint, JOINTS)
        frame = self.frames[JOINT_INDEX[joint]]
        link = self.body.link_pose(frame.link)
        local = np.eye(4)
        local[:3, :3], local[:3, 3] = frame.rotation, frame.offset
        matrix = link.matrix() @ local
        return Pose(
            tuple(matrix[:3, 3].tolist()), tuple(quaternion_from_matrix(matrix[:3, :3]).tolist())
        )

    def ignore(self, body: Body) -> None:
        """Let the person and a body pass through each other, such as the chair that the posture fits."""
        self.world.set_collision(self.body, body, False)
        if self.tissue is not None:
            SoftWorld.of(self.world).ignore([body], by=SoftBody)

    def may_take(self, what: Human | Body, part: str | None = None, *, hand: str) -> None:
        """Let a hand take a segment or a thing, by `grasp`, and pass through it for good.

        Call it before `World.mark_start`.

        Args:
            what: A person or a thing.
            part: SMPL-X joint of the person, such as `left_elbow` for the forearm; or a link of the
                thing, its base if None.
            hand: The side of the hand, `left` or `right`.

        Raises:
            UnknownNameError: If there is no such side or part.
        """
        check_name("side", hand, SIDES)
        if hand in self.hands:
            self.hands[hand].may_take(*part_of(what, part))

    def contact_forces(self, by: Body | None = None) -> dict[str, float]:
        """Return the normal force on each touched segment [N], by SMPL-X joint, after the last step.

        Args:
            by: What presses; everything if None.
        """
        forces: dict[str, float] = {}
        for contact in self.world.contacts(self.body, by):
            if contact.force > 0:
                joint = self.segment_at(contact.link_a, np.array(contact.position))
                forces[joint] = forces.get(joint, 0.0) + contact.force
        return forces

    def segment_at(self, link: int, point: Array) -> str:
        """Return the segment of a link whose surface is nearest to a point in the world [m]."""
        here = self._segments_on.get(link, [])
        if len(here) == 1:
            return here[0][0]
        if link not in self._surfaces:
            found = [
                (joint, shape_row(shape, frame.rotation, frame.offset))
                for joint, frame in here
                for shape in self.segments[joint].shapes
            ]
            rows = np.array([row for _, row in found]).reshape(-1, 16)
            self._surfaces[link] = [joint for joint, _ in found] or ["pelvis"], rows
        joints, rows = self._surfaces[link]
        pose = self.body.link_pose(link)
        local = rotate(conjugate(pose.quaternion), point - pose.position)
        return joints[nearest(rows, local)]

    def mouth_position(self) -> Array:
        """Return the point between the lips in the world [m], shape [3]; it follows head and jaw."""
        return self.mouth_and_face()[0]

    def face_direction(self) -> Array:
        """Return where the face looks, a unit vector in the world, shape [3]."""
        return self.mouth_and_face()[1]

    def mouth_and_face(self) -> tuple[Array, Array]:
        """Return the point between the lips [m] and where the face looks, each of shape [3]."""
        head_link, on_head, forward = self._face
        jaw_link, on_jaw, _ = self._jaw
        head = self.body.link_pose(head_link)
        jaw = self.body.link_pose(jaw_link) if jaw_link != head_link else head
        upper = rotate(head.quaternion, on_head) + head.position
        lower = rotate(jaw.quaternion, on_jaw) + jaw.position
        return 0.5 * (upper + lower), rotate(head.quaternion, forward)

    def angle(self, dof: str) -> float:
        """Return the present angle of a DoF [rad], fixed or movable."""
        check_name("degree of freedom", dof, DOF_INDEX)
        if dof in self._index:
            return self.body.joint_states([self._joints[self._index[dof]]])[0][0]
        return float(self.angles[DOF_INDEX[dof]])

    def observables(self) -> Sequence[Observable]:
        count = len(self.movable)
        return [
            Observable("joint_position", "rad", count, lambda: self.positions),
            Observable("joint_velocity", "rad/s", count, lambda: self.velocities),
            *self.drive.observables(),
            *self._moves.observables(),
            *(self.physiology.observables() if self._physiology_observed else ()),
        ]

    def describe(self) -> dict[str, str]:
        return {
            "avatar": self.avatar.name,
            "condition": self.avatar.condition,
            "actuation": f"{self.actuation.description}, strength {self.actuation.strength}",
            "posture": self.posture.description,
            "movable": f"{len(self.movable)} of {len(DOFS)} degrees of freedom",
        }


def part_of(what: Human | Body, part: str | None) -> tuple[Body, int]:
    """Return the body and link of a person's segment, by SMPL-X joint, or of a thing's link.

    Raises:
        UnknownNameError: If there is no such part.
    """
    if isinstance(what, Human):
        if part not in JOINT_INDEX:
            raise UnknownNameError("joint", str(part), JOINTS)
        return what.body, what.frames[JOINT_INDEX[part]].link
    return what, -1 if part is None else what.link_index(part)
