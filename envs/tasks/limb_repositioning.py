"""Limb repositioning: lift an arm that hangs beside the wheelchair and lay it on the armrest."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rcare_marl.agents.people.behaviour.behaviour_tree import GoAlong
from rcare_marl.agents.people.body.skeleton import JOINT_INDEX
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.kinematics import IkResult
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, Pose, Vector, rotate
from rcare_marl.rendering.camera import Camera
from rcare_marl.world import World

from ..care_env import CareEnv
from ..devices import ArmCradle, Wheelchair, chair_for
from ..rectangle import Rectangle
from ..registry import register_policy, register_task
from ..scenes.hanging_arm import (
    LAID,
    SWING,
    arm_weight,
    can_bear,
    come_to_rest,
    gap_to,
    swing_out_of,
)
from ..scenes.limb_repositioning_state import LAP_SEEN, LimbRepositioningState
from ..scenes.start_posture import start_best
from ..state import Seen, State, Values, degrees, tolerance, where
from ..task import CHAIR_ROBOTS, STANDING_CAREGIVER, Role, Task
from ..task_options import TaskOptions

# [N]: a man's arm weighs 31 to 38. Own choice, a third of ISO/TS 15066 for a forearm (160, from memory).
FORCE_LIMIT = 50.0
COMFORT_FORCE = 20.0  # [N] free of penalty in `shaped`: comfort of the user of the RCareWorld paper
TARGET_RADIUS, MIDDLE = 0.05, 0.03  # [m] of the forearm from the target, the pad; own choice
PAD_FORCE = 2.0  # [N] with which forearm and hand weigh on the pad at least; our own choice
TOUCH = 0.005  # [m] between forearm and pad, flesh being softer than its capsule; our own choice
LET_GO = 0.02  # [m] between the person and all that the robot moves; our own choice
STILL = 0.05  # [m/s] of the forearm that rests, over two control steps; our own choice
HOLD_TIME = 0.5  # [s] that it rests before it counts; our own choice
PROM_MARGIN = math.radians(5)  # beyond the passive range, joint stops being soft; our own choice
TIME_LIMIT = 30.0  # [s]; our own choice
CARRYING_FORCE = 100.0  # [N] from which `tool_delta` gives way, with an arm to lift; our own choice
PAD_FRICTION = 0.7  # times that of clothes, 0.6; our own choice

# Where an episode starts, uniform; our own choices.
TARGET_SPREAD = (0.03, 0.008)  # [m] of the target along and across the pad, each way
START_SPREAD = (0.03, 0.03, 0.04)  # [m] of the cradle along, across and up, each way
START_OUT = 0.13  # [m] that it starts outside the forearm
BESIDE = "wheelchair_beside"  # where robots stand that do not reach the arm from the chair
# The wrist is held straight, as by a resting splint; name it in `movable` to let the hand droop.
MOVABLE = ("left_shoulder", "left_elbow_flexion", "left_elbow_pronation")
NEEDED = (*SWING, "left_shoulder_external_rotation")


@dataclass(frozen=True)
class LimbRepositioningOptions(TaskOptions):
    """Settings of the task.

    Attributes:
        reward: `paper` as in the RCareWorld paper; `shaped` adds reach, comfort and rest.
        force_limit: Force on the person that ends the episode as a failure [N].
    """

    SHAPED_WEIGHTS = {"distance": 1.0, "reach": 0.3, "comfort": 0.3, "rest": 0.5}  # our own choice
    force_limit: float = FORCE_LIMIT


@register_task("limb_repositioning")
class LimbRepositioning(Task):
    """A robot with a padded cradle lays the left arm of a seated person on the armrest.

    Goal: the forearm rests on the armrest, let go of. Tolerance: how far off it may rest, how fast.
    Randomised at reset: how the arm swings, where the cradle starts, where on the pad the arm belongs.

    Attributes:
        chair: The wheelchair.
        cradle: What the robot lifts with.
        radius: Radius of the forearm [m].
    """

    robot = Role(Robot, default="kinova_gen3", partner="scripted", contact_force=CARRYING_FORCE)
    recipient = Role(
        Human, default="jose", posture="wheelchair_arm_out", movable=MOVABLE, partner="cooperative"
    )
    caregiver = STANDING_CAREGIVER

    reachable_by = CHAIR_ROBOTS - {"stretch_re1"} | {"hsr", "stretch_re1_dex"}
    least_success = 85
    Options = LimbRepositioningOptions
    room_kinds = ("bedroom", "living", "lounge", "dining", "kitchen")
    slack = 0.2
    paper_terms = ("distance",)
    footprint = Rectangle(-0.8, -1.1, 1.2, 1.4)  # [m] the chair, a robot or helper at its side
    time_limit = TIME_LIMIT
    options: LimbRepositioningOptions
    state: LimbRepositioningState
    chair: Wheelchair

    def furnish(self, world: World) -> dict[str, Pose]:
        posture = self.recipient.posture
        if posture.supported == "all" or "left_shoulder" in posture.supported:
            raise ConfigError(f"no left arm hangs beside an armrest: {posture.description}")
        if missing := set(NEEDED) - set(self.recipient.movable):
            raise ConfigError(f"an arm that is to be lifted moves in {', '.join(sorted(missing))}")
        where = BESIDE if BESIDE in self.robot.config.mounts else "wheelchair_left"
        self.chair = chair_for(self.robot.mount_named(where), "left")
        soles = self.recipient.soles(self.chair.frame("seat_back"))
        self.chair.fit_footplates(soles["left"], soles["right"])
        self.chair.spawn(world).set_friction([-1], lateral=PAD_FRICTION)
        self.recipient.use_arm_rests(None, self.chair.frame_in_world("armrest_right"))
        return {
            "robot": self.mounted(self.robot, where),
            "recipient": self.chair.frame_in_world("seat_back"),
            "caregiver": Pose((0.15, -0.95, 0.0), (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))),
        }

    def build(self, world: World) -> None:
        person = self.recipient
        self.let_overlap(self.chair.body)
        arm = person.body.carried_by(person.frames[JOINT_INDEX["left_shoulder"]].link)
        world.set_collision(person.body, self.chair.body, True, links_a=arm)
        self._forearm = person.frames[JOINT_INDEX["left_elbow"]].link
        self._arm, self._lower_arm = arm, person.body.carried_by(self._forearm)
        self.radius = person.segments["left_elbow"].shapes[0].size[1]
        self.feasible = can_bear(person, self.options.force_limit)
        self._let_hang()
        self.cradle = ArmCradle()
        self.cradle_body = self.cradle.spawn(world, Pose((0.0, 0.0, -10.0)))
        self._see_arm()
        lift = self.cradle.lift_way(self._elbow, self._wrist, self._place, self.radius)
        way = [self._start_pose(np.zeros(3)), *(self._tool_at(*each) for each in lift)]
        start_best(self.search(world, clear_of=[(person.body, 2 * LET_GO)]), way)
        self.take_tool(self.robot, self.cradle_body, self.cradle.in_tool)
        self.robot.control.carried = self._lower_arm
        robots = (a.body for a in self.cast.values() if isinstance(a, Robot))
        self._movers = [self.cradle_body, *robots]
        if min(self._gaps()) < LET_GO:
            raise ConfigError("the cradle touches the recipient before the episode begins")

    def _let_hang(self) -> None:
        """Find once where the arm comes to rest: laid on the armrest by hand, and hanging beside it."""
        person, pad = self.recipient, self.chair.frame_in_world("armrest_left")
        start = dict(zip(person.movable, person.positions, strict=True))
        most = 0.5 * self.chair.armrest_size[0] - TARGET_SPREAD[0]
        self._rear = pad.position[0] - 0.5 * self.chair.armrest_size[0]
        along = min(max(float(self._lay(pad, start)[0] - pad.position[0]), -most), most)
        self._place = np.add(pad.position, (along, 0.0, self.radius))
        person.set_angles(start)
        come_to_rest(self, person)
        self._hanging = dict(zip(person.movable, person.positions, strict=True))

    def _lay(self, pad: Pose, start: Mapping[str, float]) -> Array:
        """Lay the arm on the pad, as far in front as it stays, and return the middle of the forearm [m]."""
        person, best, least = self.recipient, None, TARGET_RADIUS
        for shift in LAID:
            person.set_angles(start)  # whence the arm's angles are sought
            person.set_angles(person.laid_on("left", pad @ Pose((*shift, 0.0))))
            come_to_rest(self, person)
            aside = abs(float(self._see_arm()[1] - pad.position[1]))
            if aside <= least and self._force_on_pad() >= PAD_FORCE:
                best, least = self._middle, aside
            if best is not None and least <= MIDDLE:
                break
        if best is None:
            raise ConfigError("the recipient's left arm slips off the armrest wherever it is laid")
        return best

    def _tool_at(self, place: Array, turn: Array) -> Pose:
        """Return the pose of the tool that puts the middle of the plate somewhere."""
        seat = Pose(tuple(place.tolist()), tuple(turn.tolist()))
        return seat @ self.cradle.frame("seat").inverse() @ self.cradle.in_tool.inverse()

    def _start_pose(self, offset: Vector) -> Pose:
        """Return a start pose of the tool: the cradle open towards the forearm, outside of it."""
        middle, turn = self.hook()
        return self._tool_at(middle - START_OUT * rotate(turn, (0.0, 0.0, 1.0)) + offset, turn)

    @cached_property
    def _unshifted(self) -> IkResult:  # the same in every episode
        return self.robot.solve_ik(self._start_pose(np.zeros(3)), seed=self.robot.arm.rest)

    def reset(self, rng: np.random.Generator) -> None:
        swing = {dof: rng.uniform(0.0, most) for dof, most in SWING.items()}
        offset, shift = rng.uniform(-1, 1, 3) * START_SPREAD, rng.uniform(-1, 1, 2) * TARGET_SPREAD
        self._target = self._place + (shift[0], shift[1], 0.0)
        pad = self.chair.frame_in_world("armrest_left").position[2]
        person = self.recipient
        # Less where the robot cannot reach, or the arm swings into it, or over the pad and falls there.
        for part in (1.0, 0.5, 0.0):
            person.set_angles(self._hanging)
            self._see_arm()
            tool = self._start_pose(part * offset)
            found = self.robot.solve_ik(tool, seed=self.robot.arm.rest) if part else self._unshifted
            if part:
                angles = {d: self._hanging[d] + part * a for d, a in swing.items()}
                swing_out_of(self.chair, person, angles, self._arm, LET_GO)
            self.robot.set_posture(found.posture)
            self.cradle_body.set_base(self.robot.tool_pose() @ self.cradle.in_tool)
            self._see_arm()
            beside = gap_to(self.chair, person, self._arm, LET_GO)
            is_clear = beside >= 0 and min(self._gaps()) >= LET_GO
            if is_clear and self._wrist[2] < pad and found.is_within(0.01, 0.1):
                break

    def read(self, now: State, before: LimbRepositioningState | None) -> LimbRepositioningState:
        person = self.recipient
        angles, (low, high) = np.array(person.positions), person.passive.T
        beyond = float(np.maximum(angles - high, low - angles).max())
        last, middle = self._middle, self._see_arm()
        gap, distance = self._target - middle, math.dist(self._target, middle)
        hook, plate = self.hook()[0], self.seat_pose()
        pad_force, ease = self._force_on_pad(), self.options.tolerance
        earlier, weighed = (
            (last, pad_force) if before is None else (before.earlier, before.pad_force)
        )
        # Over two looks, a period of tremor: an arm that shakes on the pad rests there, too.
        lies = 0.5 * (weighed + pad_force) >= PAD_FORCE and distance <= TARGET_RADIUS * ease
        is_still = math.dist(earlier, middle) <= STILL * ease * 2 * self.control_dt
        rests = lies and is_still and min(self._gaps()) >= LET_GO
        lap_gap = self.world.separation(
            self.cradle_body, person.body, within=LAP_SEEN, links=(-1, -1)
        )
        past = (0.0, 0.0) if before is None else (before.beyond, before.rested)
        return LimbRepositioningState(
            **vars(now),
            elbow=self._elbow,
            wrist=self._wrist,
            target=self._target,
            gap=gap,
            distance=distance,
            hook=hook,
            plate=np.array(plate.position),
            plate_turn=np.array(plate.quaternion),
            plate_up=rotate(plate.quaternion, (1.0, 0.0, 0.0)),
            plate_inward=rotate(plate.quaternion, (0.0, 0.0, 1.0)),
            reach=math.dist(hook, plate.position),
            past_end=float(self._elbow[0] - self._rear),
            lap_gap=min(lap_gap, LAP_SEEN),
            arm_weight=arm_weight(person),
            pad_force=pad_force,
            earlier=last,
            beyond=max(past[0], beyond),
            rested=past[1] + self.control_dt if rests else 0.0,
        )

    def _see_arm(self) -> Array:
        """Take note of where the arm is, and return the middle of the forearm [m], shape [3]."""
        joints = (self.recipient.joint_pose(f"left_{name}") for name in ("elbow", "wrist"))
        self._elbow, self._wrist = (np.array(pose.position) for pose in joints)
        self._middle: Array = 0.5 * (self._elbow + self._wrist)
        return self._middle

    def _gaps(self) -> list[float]:
        """Return how far all that robots move is from the person [m], no farther than it matters."""
        gap, body = self.world.separation, self.recipient.body
        return [gap(mover, body, within=2 * LET_GO) for mover in self._movers]

    def _force_on_pad(self) -> float:
        """Return how forearm and hand weigh on the pad [N], not at all unless the forearm touches it."""
        person, chair, gap = self.recipient.body, self.chair.body, self.world.separation
        force = self.chair.load_on_armrest("left", self.world, person, self._lower_arm)
        links = (self._forearm, -1)
        return force * (force > 0 and gap(person, chair, within=2 * TOUCH, links=links) <= TOUCH)

    def observables(self, role: str) -> Sequence[Seen]:
        return [
            Seen("seat_position", "m", 3, lambda s: s.plate),
            Seen("seat_to_hook", "m", 3, lambda s: s.hook - s.plate),
            Seen("seat_up", "1", 3, lambda s: s.plate_up),
            Seen("seat_inward", "1", 3, lambda s: s.plate_inward),
            Seen("elbow_position", "m", 3, lambda s: s.elbow),
            Seen("wrist_position", "m", 3, lambda s: s.wrist),
            Seen("forearm_to_target", "m", 3, lambda s: s.gap),
            Seen("force_on_armrest", "N", 1, lambda s: s.pad_force),
            Seen("elbow_past_armrest", "m", 1, lambda s: s.past_end),
            Seen("lap_gap", "m", 1, lambda s: s.lap_gap),
            Seen("arm_weight", "N", 1, lambda s: s.arm_weight),
            self.contact_force(),
            self.time_left(),
        ]

    def rewards(self, role: str, state: LimbRepositioningState) -> Mapping[str, Values]:
        terms = {"distance": -state.distance}
        if self.options.reward == "shaped":
            lies = state.pad_force >= PAD_FORCE
            near = tolerance(state.distance, bounds=(0, TARGET_RADIUS), margin=0.2)
            terms["reach"] = -where(lies, 0.0, state.reach)
            terms["comfort"] = -self.options.discomfort(state.force, COMFORT_FORCE)
            terms["rest"] = where(lies, near - 1.0, -1.0)
            terms = self.options.weighted(terms)
        # Every term is a cost, so that to end well ends the costs. An episode that ends badly is charged
        # as if it had stayed as it was: else to hurt somebody at once would cost least.
        step = sum(terms.values())
        return {**terms, "failed": self.for_the_rest(state, self.failed(state), step)}

    def metrics(self, state: LimbRepositioningState) -> Mapping[str, Values]:
        return {
            "distance_m": state.distance,
            "force_on_armrest_n": state.pad_force,
            "rested_s": state.rested,
            "beyond_prom_deg": degrees(state.beyond),
        }

    def is_success(self, state: LimbRepositioningState) -> Values:
        """Return whether the forearm has rested on the pad, still and untouched, long enough."""
        return state.rested >= HOLD_TIME - 1e-9

    def is_failure(self, state: LimbRepositioningState) -> Values:
        """Return whether a joint was beyond its passive range."""
        return state.beyond > PROM_MARGIN

    def hook(self, share: float | None = None) -> tuple[Array, Array]:
        """Return place and turn of the cradle's plate that lifts the forearm, as `ArmCradle.under`."""
        return self.cradle.under(self._elbow, self._wrist, self.radius, share)

    def seat_pose(self) -> Pose:
        """Return the pose of the cradle's plate: middle of its top, x out of it, z to its tip."""
        return self.cradle_body.base_pose() @ self.cradle.frame("seat")

    def camera(self) -> Camera:
        far = 1.0 if self.chair.carries_robot else 1.25  # others stand beside, and are larger
        return Camera(eye=(-1.3 * far, 1.75 * far, 1.6), target=(0.05, 0.25, 0.72), fov_deg=38)


@register_policy("limb_repositioning", "recipient", "cooperative")
def cooperative(env: CareEnv, role: str) -> GoAlong:
    """Return a recipient who relaxes and lets the arm go where it is taken."""
    assert isinstance(task := env.task, LimbRepositioning)
    return GoAlong(task.recipient, task.control_dt)
