"""Bathing: wipe the upper arm of a person who lies in bed, from shoulder to elbow, without pushing."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.pose import Array, Pose, about_z, quaternion_from_matrix
from rcare_marl.rendering.camera import Camera
from rcare_marl.world import World

from ..devices import HospitalBed, Sponge, lay_under
from ..reach import Trial
from ..rectangle import Rectangle
from ..registry import register_task
from ..scenes.refusal import Refusal, RefusalOptions, refusal_seen
from ..scenes.wiped_skin import WipedSkin, pad
from ..state import Seen, State, Values
from ..task import CHAIR_ROBOTS, STANDING_CAREGIVER, Role, Task
from ..task_options import FORCE_LIMIT

COMFORT_FORCE = 12.0  # [N] above it PhyRC's bathing takes points; used by the shaped reward
REACHED = 0.025  # [m] from target to the middle of the sponge's face: Assistive Gym, bed_bathing.py
LEAST_FORCE = 0.3  # [N] with which a sponge wipes; own choice
STROKE_FROM = 0.5  # of the way to the elbow: where a stroke must have begun at most; own choice
LEAST_COVERAGE = 0.3  # share of the skin that must be wiped: success of Assistive Gym's bathing
# Of the way from shoulder to elbow, where wiping begins, and about the arm: as near to the shoulder as
# the sponge keeps off the chest; own choice.
START_SHARE, START_ANGLE = 0.38, math.radians(-12)
TRUNK_SEEN = 0.05  # [m] of room beside the sponge that is observed, at most; own choice
TARGET_SHARE = (0.85, 0.95)  # of the way to the elbow: randomised, as the paper says; own choice
TARGET_ANGLE = math.radians(15)  # about the arm, uniform each way; own choice
# [m] nearer the trunk than a robot's links may be (6 mm), as a sponge gives way; own choice
SOFT = 0.009
# [m] from skin to sponge: within offered, beyond no more; own choice
OFFERED, TAKEN_AWAY = (0.06, 0.08)
START_GAP = (0.10, 0.18)  # [m] from skin to sponge at the start; own choice
ENDS = (START_SHARE, TARGET_SHARE[1])  # of the way to the elbow, that must be reached
START_SPREAD = 0.04  # [m] along and across, uniform each way; own choice
# How the arm lies, uniform each way. What holds a weak arm takes half of it back; own choice.
ARM_TURN, ELBOW_BEND = math.radians(8), math.radians(12)
# Shares of that and of the spread, tried until a robot is so far from arm and bed [m]; own choice.
TRIED, ROOM, BESIDE = (1.0, 0.8, 0.6, 0.4, 0.2, 0.0), 0.02, 0.005
LEVEL, STRAIGHTER = 0.25, 0.02  # [rad] that a sponge may lie askew; worth another hold; own choice
MISS = 0.02  # [m] by which the ends may be missed; own choice
BED_RAISE = 0.27  # [m] of the platform over its lowest: a height to work at; own choice
ROBOT_RADIUS = 0.35  # [m] of a robot on the floor; own choice
FORCE_WEIGHT = 0.01  # [1/N] of force against metres: Assistive Gym, config.ini
HURT = 1.0 + FORCE_WEIGHT * FORCE_LIMIT  # a step that is left when someone was hurt: own choice

SIDE = "left"  # of the arm: that of the paper's trial
MOVABLE = (f"{SIDE}_shoulder", f"{SIDE}_elbow_flexion")


@dataclass(frozen=True)
class BathingOptions(RefusalOptions):
    """Settings of the bathing task.

    Attributes:
        reward: `paper` as in the RCareWorld paper; `shaped` adds what was wiped, and comfort.
        force_limit: Force on the person that ends the episode as a failure [N].
        least_coverage: Share of the upper arm's upper side that must be wiped for success.
    """

    SHAPED_WEIGHTS = {"distance": 1.0, "wiped": 10.0, "comfort": 0.5, "reached": 10.0}  # own choice

    least_coverage: float = LEAST_COVERAGE

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.least_coverage <= 1:
            raise ValueError(f"least_coverage must lie in 0..1, got {self.least_coverage}")


@dataclass(frozen=True, eq=False)
class BathingState(State):
    """What bathing reads."""

    face: Array  # middle of the sponge's face [m], shape [3]
    turn: Array  # how the sponge is turned, a quaternion, shape [4]
    target: Array  # on the elbow [m], shape [3]
    distance: float  # from there to the middle of the face [m]
    shoulder: Array  # where the shoulder is [m], shape [3]
    elbow: Array  # likewise
    push: Array  # force of the sponge on the recipient in the last physics step [N], shape [3]
    push_size: float  # its size [N]
    trunk_gap: float  # from the sponge to the trunk beside it [m], `TRUNK_SEEN` at most
    covered: float  # share of the skin to be wiped that was
    gained: float  # what it grew by in the control step
    # where the present stroke began, as a share of the way to the elbow; infinite between strokes
    stroke_from: float
    is_reached: bool  # whether it has come to the target in one stroke, and enough was wiped
    refusal: Refusal  # what the recipient did not want


@register_task("bathing")
class Bathing(Task):
    """A robot beside the bed wipes the upper arm of the person who lies in it with a wet sponge.

    Success: the sponge comes to a target on the elbow in one stroke from the shoulder's half of the upper
    arm, and enough of its upper side was wiped; or the person refused for good, and that was respected.
    Failure: a force above the limit on the person, or above 5 N after a no.
    Randomised at reset: target, start of the sponge, how the arm lies.
    Tolerance: how close to the target is close enough; the share to be wiped is divided by it.
    """

    robot = Role(Robot, default="kinova_gen2", partner="scripted")
    recipient = Role(
        Human,
        default="natalia",
        posture="bed_supine",
        movable=MOVABLE,
        partner="still",
        speaks=True,
    )
    caregiver = STANDING_CAREGIVER

    reachable_by = CHAIR_ROBOTS | {"hsr", "pepper", "stretch_re1_dex"}
    least_success = 95
    Options = BathingOptions
    room_kinds = ("bedroom", "living", "lounge", "dining")
    slack = 0.05
    footprint = Rectangle(-1.15, -1.1, 1.15, 0.55)  # [m] the bed, and a robot at its side
    options: BathingOptions
    state: BathingState

    def free_floor(self) -> Rectangle:
        low, base = self.footprint, self.robot.mount_named("bed_side").pose.position
        far = 1.2 if "caregiver" in self.cast else low.y1
        return Rectangle(low.x0, min(low.y0, base[1] - ROBOT_RADIUS), low.x1, far)

    def furnish(self, world: World) -> dict[str, Pose]:
        posture = self.recipient.posture
        self.need(posture, posture.recline_deg == 90, "lie on the back")
        self._bed = HospitalBed()
        half = 0.5 * self._bed.model.figure("mattress_length") + self._bed.model.figure("end")
        # Mounts beside a bed have its head at +x.
        self._bed.spawn(world, Pose((half, 0.0, 0.0), about_z(math.pi)))
        self._bed.set_position("height", BED_RAISE)
        return {
            "robot": self.mounted(self.robot, "bed_side"),
            "recipient": self._bed.frame_in_world("mattress"),
            "caregiver": Pose((0.35, 0.85, 0.0), about_z(-math.pi / 2)),
        }

    def build(self, world: World) -> None:
        self.let_overlap(self._bed.body)
        self.recipient.supports.append(self._bed.body)
        self.skin = WipedSkin(self.recipient, world, f"{SIDE}_shoulder", f"{SIDE}_elbow")
        pad(self.recipient, world, [f"{SIDE}_{part}" for part in ("shoulder", "elbow")])
        under = float(min(self.skin.place(share, math.pi)[0][2] for share in (0.5, 0.9)))
        lay_under(world, self.recipient, SIDE, base=self._bed.mattress_height(), under=under)
        self.sponge = Sponge()
        sponge = self.sponge.spawn(world)
        self.sponge.spare(self.robot.body)
        self._find_hold(world)
        self._set_sponge(self._over(START_SHARE, START_GAP[1]))
        self.take_tool(self.robot, sponge, self._grip)

    def _find_hold(self, world: World) -> None:
        """Find how the sponge is held so that the robot reaches both ends of the upper arm.

        It need not reach the farthest start, but must be clear of people as it tries to.
        """
        trials = []
        for hold in itertools.product(self.sponge.grips, (1.0, -1.0)):
            self._grip, self._flip = hold
            places = (*((s, START_GAP[0]) for s in ENDS), (START_SHARE, START_GAP[1]))
            way = [self._tool_for(self._over(*place)) for place in places]
            trials.append(Trial(way, hold=hold))
        search = self.search(
            world,
            clear_of=[(self._bed.body, BESIDE)],
            needed=len(ENDS),
            all_the_way=True,
            within=lambda found: found.is_within(MISS, LEVEL),
            cost=lambda before, after: max(before.angle, after.angle) // STRAIGHTER,
        )
        self._grip, self._flip = search.find(trials, "all of the upper arm").trial.hold

    def _over(self, share: float, gap: float, offset: Sequence[float] = (0.0, 0.0)) -> Pose:
        """Return a pose of the sponge's face over the arm, facing it; offset along and across [m]."""
        point, out = self.skin.place(share, START_ANGLE)
        way = self.skin.direction()
        at = point + gap * out + offset[0] * way + offset[1] * np.cross(out, way)
        return Pose(tuple(at.tolist()), tuple(self.wiping_quaternion(out, way).tolist()))

    def _tool_for(self, face: Pose) -> Pose:
        return face @ self.sponge.frame("face").inverse() @ self._grip.inverse()

    def _set_sponge(self, face: Pose) -> None:
        """Put the robot where the face of the sponge in its hand is at `face`."""
        self.robot.set_tool(self._tool_for(face))
        self.sponge.body.set_base(self.robot.tool_pose() @ self._grip)

    def reset(self, rng: np.random.Generator) -> None:
        self._bed.reset()
        turn, bend = rng.uniform(-ARM_TURN, ARM_TURN), rng.uniform(0.0, ELBOW_BEND)
        spread = rng.uniform(-START_SPREAD, START_SPREAD, 2)
        gap = rng.uniform(*START_GAP)
        self._target_at = rng.uniform(*TARGET_SHARE), rng.uniform(-TARGET_ANGLE, TARGET_ANGLE)
        dofs = {f"{SIDE}_shoulder_abduction": turn, f"{SIDE}_elbow_flexion": bend}
        moving = self.recipient.movable
        rest = {d: self.recipient.angle(d) for d in dofs if d in moving}
        for share in TRIED:
            self.recipient.set_angles({d: angle + share * dofs[d] for d, angle in rest.items()})
            self.skin.follow()
            away = share * gap + (1 - share) * START_GAP[1]
            self._set_sponge(self._over(START_SHARE, away, (share * spread).tolist()))
            if self._has_room():
                break
        self.skin.reset()

    def _has_room(self) -> bool:
        """Return whether the robot is clear of the person and, its base too, of the bed."""
        robot, apart = self.robot.body, self.world.separation
        kept = ((self.recipient.body, ROOM), (self._bed.body, BESIDE))
        return all(apart(robot, body, within=gap) >= gap for body, gap in kept)

    def read(self, now: State, before: BathingState | None) -> BathingState:
        self.skin.follow()
        points = self.sponge.face_points()
        face, target = points.mean(axis=0), self.skin.place(*self._target_at)[0]
        gap = target - face
        distance = math.sqrt(float(gap @ gap))
        push = self.sponge.force_on(self.recipient.body)
        presses = float(push @ push) > LEAST_FORCE**2
        self.skin.wipe(points if presses else points[:0], self.control_dt)
        covered, stroke_from = self.skin.coverage, math.inf
        if presses:
            begun = math.inf if before is None else before.stroke_from
            stroke_from = min(begun, self.skin.progress(face))
        sponge, person = self.sponge.body, self.recipient.body
        near = self.world.near(sponge, person, within=TRUNK_SEEN, links=(-1, -1))
        trunk_gap = min((there.gap for there in near), default=TRUNK_SEEN)
        hand = self.robot.arm.hand[-1]  # which the sponge moves with
        pressed = [n._replace(link=hand, gap=n.gap + SOFT) for n in near]
        self.robot.control.near = [*self.robot.control.near, *pressed]
        ease = self.options.tolerance
        is_there = stroke_from < STROKE_FROM and distance < REACHED * ease
        is_reached = is_there and covered * ease >= self.options.least_coverage
        shoulder, elbow = (
            np.array(self.recipient.joint_pose(f"{SIDE}_{j}").position)
            for j in ("shoulder", "elbow")
        )
        return BathingState(
            **vars(now),
            face=face,
            turn=np.array(self.sponge.pose.quaternion),
            target=target,
            distance=distance,
            shoulder=shoulder,
            elbow=elbow,
            push=push,
            push_size=float(np.linalg.norm(push)),
            trunk_gap=trunk_gap,
            covered=covered,
            gained=covered if before is None else covered - before.covered,
            stroke_from=stroke_from,
            is_reached=is_reached or (before is not None and before.is_reached),
            refusal=self._refused(now, before, face),
        )

    def _refused(self, now: State, before: BathingState | None, face: Array) -> Refusal:
        """Return what the recipient has refused."""
        share = min(max(float(self.skin.progress(face)), 0.0), 1.0)
        skin, out = self.skin.place(share, START_ANGLE)
        gap = float((face - skin) @ out)
        return (Refusal() if before is None else before.refusal).after(
            says_no=self.recipient.says_no,
            is_offered=gap < OFFERED,
            is_away=gap > TAKEN_AWAY,
            force=float(now.force),
        )

    def observables(self, role: str) -> Sequence[Seen]:
        return [
            Seen("sponge_position", "m", 3, lambda s: s.face),
            Seen("sponge_to_target", "m", 3, lambda s: s.target - s.face),
            Seen("shoulder_position", "m", 3, lambda s: s.shoulder),
            Seen("elbow_position", "m", 3, lambda s: s.elbow),
            Seen("sponge_force", "N", 3, lambda s: s.push),
            self.contact_force(),
            Seen("coverage", "1", 1, lambda s: s.covered),
            Seen("in_stroke", "1", 1, lambda s: s.stroke_from < STROKE_FROM),
            Seen("trunk_gap", "m", 1, lambda s: s.trunk_gap),
            self.time_left(),
            *refusal_seen(self.options),
        ]

    def rewards(self, role: str, state: BathingState) -> Mapping[str, Values]:
        terms = {"distance": -state.distance, "force": -FORCE_WEIGHT * state.force}
        if self.options.reward == "shaped":
            excess = self.options.discomfort(state.force, COMFORT_FORCE)
            reached = self.succeeded(state) * 1.0
            terms = {"distance": -state.distance, "wiped": state.gained, "reached": reached}
            terms |= {"comfort": -excess}
            terms = self.options.weighted(terms)
        # All terms of a step are losses: without this, to hurt would end them and pay.
        return {**terms, "hurt": self.for_the_rest(state, self.failed(state), -HURT)}

    def literal(self, role: str, state: BathingState) -> Mapping[str, Values]:
        return {"distance": -state.distance, "force": -state.push_size}

    def metrics(self, state: BathingState) -> Mapping[str, Values]:
        return {
            "distance_m": state.distance,
            "coverage": state.covered,
            "sponge_force_n": state.push_size,
            **state.refusal.metrics(),
        }

    def is_success(self, state: BathingState) -> Values:
        return state.is_reached | state.refusal.is_respected

    def is_failure(self, state: BathingState) -> Values:
        return state.refusal.is_hurt

    def target_on_arm(self) -> tuple[float, float]:
        """Return how far along the upper arm the target is, as a share, and at which angle [rad]."""
        return self._target_at

    def wiping_quaternion(self, out: Array, way: Array) -> Array:
        """Return how the sponge is turned that lies across the arm, shape [4].

        Args:
            out: Out of the arm, a unit vector in the world, shape [3].
            way: Along the arm, at right angles to it.
        """
        across = self._flip * np.cross(out, way)
        return quaternion_from_matrix(np.column_stack((across, np.cross(-out, across), -out)))

    def camera(self) -> Camera:
        return Camera(eye=(-0.5, -0.6, 1.45), target=(0.45, -0.22, 0.78), fov_deg=42)
