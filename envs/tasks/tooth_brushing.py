"""Tooth brushing: clean the outer side of somebody's teeth, quadrant by quadrant, by gentle strokes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from rcare_marl.agents.people.behaviour.behaviour_tree import BehaviourTree, eat_when_fed
from rcare_marl.agents.robots.kinematics import IkResult
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, Pose, quaternion_from_matrix, turn_to, turned_and_raised
from rcare_marl.world import World

from ..broadcast import clip, norm, where
from ..care_env import CareEnv
from ..devices import Device
from ..reach import Trial, manipulability
from ..registry import register_policy, register_task
from ..scenes.brushing_state import ToothBrushingState
from ..scenes.dental_arch import BRISTLES, CROWN, QUADRANTS, MouthInside
from ..scenes.meal import Meal, MealOptions
from ..scenes.refusal import RefusalOptions, refusal_seen
from ..state import Seen, State, Values, tolerance
from ..task import CHAIR_ROBOTS

Hold = tuple[float, float]

# [N] with which a quadrant is cleaned; our own choice. People brush with 1.6 N, SD 0.3 (A. Wiegand et al.,
# Clin. Oral Investig. 17, 2013), or 3.2 N (G. van der Weijden et al., J. Clin. Periodontol. 25, 1998).
PRESS = (0.5, 2.5)
COMFORT_FORCE = 3.0  # [N] free of penalty; our own choice, as all that follows
STROKE = 0.01  # [m/s] along the teeth at least
BRUSHED = 3.0  # [s] of strokes that clean a quadrant, in place of the 30 s that are advised
# Of the arch's depth, behind the foremost tooth, where a brush is aimed at: the premolars.
BACK = 0.42
# [rad] that the brush comes in from the other side, and points up to the upper and to the lower teeth.
YAW, PITCH, LOWER = math.radians(10), math.radians(12), math.radians(9)
# Who looks aside or up at the brush would have it come from where no arm reaches: it comes no farther from
# the side than this of a face at rest, but by the least from the other side, as it must between the lips
# [rad]. What is over comes from below instead, to the lower teeth this share of it: their lip is in the way.
ASIDE, LEAST, FROM_BELOW_LIP = math.radians(14), math.radians(4), 0.4
START_GAP = (0.13, 0.19)  # [m] from the lips to the tip at the start
START_SPREAD = (0.04, 0.03)  # [m] across and up, uniform each way
HEAD_TURN, HEAD_TILT = math.radians(12), math.radians(6)  # uniform, each way
# [m] along the brush from the teeth to where it waits before the mouth; from bristles to teeth on its way in
BEFORE, CLEAR = 0.085, 0.006
# Tried in turn: how much more the brush comes from below to the upper teeth, and how it is rolled [rad].
FROM_BELOW = (0.0, 0.15, 0.3)
ROLLS = tuple(math.radians(a) for a in range(0, 360, 45))
# [rad] by which a joint may go between places; what a singular posture costs, over its manipulability
OTHER_WAY, SINGULAR = 2.2, 0.05
MISS, MISS_TURN = 0.01, 0.1  # [m] of the way that may be missed, also per radian


@dataclass(frozen=True)
class ToothBrushingOptions(RefusalOptions, MealOptions):
    """Settings of the tooth brushing task.

    Attributes:
        reward: `paper` in the manner of the RCareWorld paper's bathing, which has no tooth brushing; `shaped`
            adds comfort.
    """

    SHAPED_WEIGHTS = {"distance": 1.0, "brushed": 10.0, "comfort": 0.5, "clean": 10.0}


@register_task("tooth_brushing")
class ToothBrushing(Meal):
    """A robot on the wheelchair brushes the teeth of the person who sits in it.

    Success: three seconds of strokes with 0.5 to 2.5 N on the outer side of each quadrant; or the person
    refused for good, and that was respected. Failure: a force above the limit on the person, or above 5 N
    after a no.
    Randomised at reset: where the brush starts, how the head is turned and tilted.
    Tolerance: the time of brushing is divided by it.
    """

    room_kinds = ("bathroom", "bedroom", "living", "lounge", "kitchen")
    reachable_by = CHAIR_ROBOTS - {"stretch_re1"} | {"stretch_re1_dex"}
    least_success = 90
    engines = ("bullet",)  # the rigid face lets the brush in during an episode
    time_limit = 60.0
    Options = ToothBrushingOptions
    options: ToothBrushingOptions
    state: ToothBrushingState

    def build(self, world: World) -> None:
        super().build(world)
        self.brush = Device("toothbrush")
        body = self.brush.spawn(world)
        world.set_collision(body, self.chair.body, False)
        middle, tip = (self.brush.frame(name).position[2] for name in ("bristles", "tip"))
        half = tip - middle - BRISTLES
        self.inside = MouthInside(world, self.recipient, body, (middle - half, middle + half))
        world.matter.append(self.inside)
        self._mouth_at_rest, self.face_at_rest = self.recipient.mouth_and_face()
        self._hold: Hold = (0.0, 0.0)
        self._hold = self._find_hold(world)
        self._set_brush(np.zeros(3))
        self.take_tool(self.robot, body, Pose())
        self._forget()

    def _find_hold(self, world: World) -> Hold:
        """Find how the robot holds the brush so that it reaches all quadrants of an open mouth.

        Raises:
            ConfigError: If it cannot.
        """
        person, jaw = self.recipient, "jaw_opening"
        if jaw not in person.movable:
            raise ConfigError(f"{person.name!r} needs {jaw!r} among the movable degrees of freedom")
        person.set_angles({jaw: 0.7 * float(person.active[person.movable.index(jaw), 1])})
        holds = list(itertools.product(FROM_BELOW, ROLLS))
        ways = [[self._start_pose(np.zeros(3), hold)] for hold in holds]
        for turned in (HEAD_TURN, -HEAD_TURN):  # as far as episodes may begin
            self._face_aside(turned)
            for way, hold in zip(ways, holds, strict=True):
                for quadrant in range(len(QUADRANTS)):
                    place, _, into = self.aim(quadrant, hold)
                    way += [self._tool_for(place - gap * into, into, hold) for gap in (BEFORE, 0.0)]
        trials = [Trial(way, hold=hold) for way, hold in zip(ways, holds, strict=True)]
        search = self.search(
            world,
            all_the_way=True,
            roams=False,
            within=lambda found: found.distance + MISS_TURN * found.angle < MISS,
            cost=self._effort,
            crowding=self.crowding,
            rests=True,
        )
        found = search.find(trials, "all teeth")
        person.set_angles({jaw: 0.0})
        self._face_aside(0.0)
        self._near = self.robot.arm.rest = found.posture
        return cast(Hold, found.trial.hold)

    def _face_aside(self, turned: float) -> None:
        """Turn the recipient's head to the left [rad]."""
        dofs = [dof for dof in self._head_dofs if dof.endswith("rotation_left")]
        self.recipient.set_angles(dict.fromkeys(dofs, turned / max(len(dofs), 1)))

    def _effort(self, before: IkResult, after: IkResult) -> float:
        """Return what a place costs after another [rad]."""
        turned = np.abs(np.angle(np.exp(1j * (after.posture - before.posture)))).max()
        if turned > OTHER_WAY:
            return math.inf
        return float(turned) + SINGULAR / max(manipulability(self.robot, after.posture), 1e-6)

    def aim(self, quadrant: int, hold: Hold | None = None) -> tuple[Array, Array, Array]:
        """Return where and how the brush should be at a quadrant now, in the world, each of shape [3].

        That is where the middle of the bristles just touches [m], the way out of the teeth there, and the way
        along the brush into the mouth, unit vectors.
        """
        pitch, _ = hold or self._hold
        row, side = divmod(quadrant, 2)
        aside = (1.0, -1.0)[side]
        frame = self.inside.frame(row)
        node, outward = self.inside.arches[row].beside(aside, BACK)
        turned, raised = turned_and_raised(self.inside.frame(0)[:3, 2], self.face_at_rest)
        turn = aside * float(np.clip(ASIDE + aside * turned, LEAST, YAW))
        over = max(raised, 0.0) + max(abs(turned - turn) - ASIDE, 0.0)
        rise = LOWER + FROM_BELOW_LIP * over if row else PITCH + pitch + over
        into = np.array(
            (math.sin(turn) * math.cos(rise), math.sin(rise), -math.cos(turn) * math.cos(rise))
        )
        place = frame[:3, :3] @ (node + (CROWN + BRISTLES) * outward) + frame[:3, 3]
        return place, frame[:3, :3] @ outward, self.inside.frame(0)[:3, :3] @ into

    def brush_quaternion(self, into: Array, hold: Hold | None = None) -> Array:
        """Return how the brush is turned that points along a unit vector of the world, shape [4]."""
        _, roll = hold or self._hold
        x = np.cross((0.0, 0.0, 1.0), into)
        x = x / np.linalg.norm(x)
        x = math.cos(roll) * x + math.sin(roll) * np.cross(into, x)
        return quaternion_from_matrix(np.column_stack((x, np.cross(into, x), into)))

    def _tool_for(self, bristles: Array, into: Array, hold: Hold | None = None) -> Pose:
        """Return the pose of the robot's tool with the bristles at a place [m], the brush along a way."""
        at = Pose(tuple(bristles.tolist()), tuple(self.brush_quaternion(into, hold).tolist()))
        return at @ self.brush.frame("bristles").inverse()

    def _start_pose(self, offset: Array, hold: Hold | None = None) -> Pose:
        """Return the pose of the robot's tool before the face; the offset is ahead, across and up [m]."""
        face = self.face_at_rest * (1.0, 1.0, 0.0)
        face = face / np.linalg.norm(face)
        across = np.cross((0.0, 0.0, 1.0), face)
        gap = START_GAP[0] + float(offset[0])
        at = self._mouth_at_rest + gap * face + offset[1] * across
        return self._tool_for(at + (0.0, 0.0, offset[2]), -face, hold)

    def _set_brush(self, offset: Array) -> None:
        """Put the robot where the brush starts."""
        self.robot.set_tool(self._start_pose(offset), self._near)
        self.brush.body.set_base(self.robot.tool_pose())

    def reset(self, rng: np.random.Generator) -> None:
        self.turn_head(rng, HEAD_TURN, HEAD_TILT)
        most = (START_GAP[1] - START_GAP[0], *START_SPREAD)
        self._set_brush(rng.uniform((0.0, *np.negative(START_SPREAD)), most))
        self._forget()

    def _forget(self) -> None:
        """Begin a control step: nothing was felt in it yet."""
        self._pressed, self._steps = 0.0, 0
        self._cleaned, self._pushed = np.zeros(len(QUADRANTS)), np.zeros(3)

    def offered_position(self) -> Array:
        """Return where the middle of the bristles is in the world [m], shape [3]."""
        return self.state.bristles

    def after_substep(self) -> None:
        self._pressed += self.world.contact_force(self.recipient.body, self.brush.body)
        self._cleaned += self.inside.outside
        self._pushed += self.inside.push
        self._steps += 1

    def read(self, now: State, before: ToothBrushingState | None) -> ToothBrushingState:
        pose = self.brush.pose
        bristles = np.array((pose @ self.brush.frame("bristles")).position)
        mouth, face = self.recipient.mouth_and_face()
        frames = [self.inside.frame(row) for row in range(2)]
        local = np.array([frame[:3, :3].T @ (bristles - frame[:3, 3]) for frame in frames])
        steps = max(self._steps, 1)
        press, cleaning, push = self._pressed / steps, self._cleaned / steps, self._pushed / steps
        self._forget()
        aims = [self.aim(quadrant) for quadrant in range(len(QUADRANTS))]
        targets, outward, into = np.swapaxes(aims, 0, 1)
        speed, brushed, gained = np.zeros(2), np.zeros(len(QUADRANTS)), 0.0
        if before is not None:
            # Off the teeth and onto them is no stroke.
            moved = local - before.local
            normal = np.array([frames[q // 2][:3, :3].T @ way for q, way in enumerate(outward)])
            rows = np.repeat(moved, 2, axis=0)
            along = np.linalg.norm(rows - (rows * normal).sum(1)[:, None] * normal, axis=1)
            along /= self.control_dt
            speed = along.reshape(2, 2).max(axis=1)
            helps = (cleaning >= PRESS[0]) & (cleaning <= PRESS[1]) & (along >= STROKE)
            brushed = before.brushed + where(helps, self.control_dt, 0.0)
            enough = BRUSHED / self.options.tolerance
            gained = float((np.minimum(brushed, enough) - np.minimum(before.brushed, enough)).sum())
        way, dirty = bristles - mouth, np.flatnonzero(~self.is_clean(brushed))
        left = dirty[0] if len(dirty) else -1  # the first that is not clean, or else the last
        return ToothBrushingState(
            **vars(now),
            bristles=bristles,
            to_turn=turn_to(self.brush_quaternion(into[left]), pose.quaternion),
            axis=pose.matrix()[:3, 2],
            mouth=mouth,
            face=face,
            bowed=float(self.face_at_rest[2] - face[2]),
            jaw=self.recipient.angle("jaw_opening"),
            is_inside=self.inside.is_inside,
            distance=math.sqrt(float(way @ way)),
            targets=targets,
            outward=outward,
            to_next=targets[left] - bristles,
            next_outward=outward[left],
            next_into=into[left],
            next_force=float(cleaning[left]),
            push=push,
            press=press,
            cleaning=cleaning,
            speed=speed,
            brushed=brushed,
            gained=gained,
            local=local,
            refusal=self.refused(now, before, face, way),
        )

    def is_clean(self, brushed: Values) -> Values:
        """Return which quadrants were brushed long enough, from how long each was [s]."""
        return brushed * self.options.tolerance >= BRUSHED - 1e-9

    def observables(self, role: str) -> Sequence[Seen]:
        return [
            Seen("bristles_position", "m", 3, lambda s: s.bristles),
            Seen("brush_axis", "1", 3, lambda s: s.axis),
            Seen("bristles_to_mouth", "m", 3, lambda s: s.mouth - s.bristles),
            Seen("bristles_to_teeth", "m", 3, lambda s: s.to_next),
            Seen("teeth_outward", "1", 3, lambda s: s.next_outward),
            Seen("teeth_along", "1", 3, lambda s: s.next_into),
            Seen("brush_to_turn", "rad", 3, lambda s: s.to_turn),
            Seen("face_direction", "1", 3, lambda s: s.face),
            Seen("face_bowed", "1", 1, lambda s: s.bowed),
            Seen("jaw_opening", "rad", 1, lambda s: s.jaw),
            Seen("in_mouth", "1", 1, lambda s: where(s.is_inside, 1.0, 0.0)),
            Seen("brush_push", "N", 3, lambda s: s.push),
            Seen("brush_force", "N", 1, lambda s: s.press),
            Seen("quadrant_force", "N", len(QUADRANTS), lambda s: s.cleaning),
            Seen("next_force", "N", 1, lambda s: s.next_force),
            Seen("brushed", "s", len(QUADRANTS), lambda s: s.brushed),
            self.contact_force(),
            self.time_left(),
            *refusal_seen(self.options),
        ]

    def rewards(self, role: str, state: ToothBrushingState) -> Mapping[str, Values]:
        away = norm(state.to_next)
        near = tolerance(away, bounds=(0, 0.01), margin=0.2)
        terms = {"near": near, "brushed": state.gained / self.control_dt}
        best = 2.0  # what ends well is paid as if it went on
        if self.options.reward == "shaped":
            excess = self.options.discomfort(state.force, COMFORT_FORCE)
            clean = self.succeeded(state) * 1.0
            terms = {"distance": -away, "brushed": state.gained, "clean": clean}
            terms = self.options.weighted(terms | {"comfort": -excess})
            best = self.options.weight("brushed") * self.control_dt
        return {**terms, "done": self.for_the_rest(state, self.succeeded(state), best)}

    def metrics(self, state: ToothBrushingState) -> Mapping[str, Values]:
        shares = clip(state.brushed * self.options.tolerance / BRUSHED, 0.0, 1.0)
        found = {f"brushed_{name}_s": state.brushed[..., k] for k, name in enumerate(QUADRANTS)}
        return {
            "distance_m": state.distance,
            **found,
            "clean": shares.sum(-1) / len(QUADRANTS),
            "brush_force_n": state.press,
            **state.refusal.metrics(),
        }

    def is_success(self, state: ToothBrushingState) -> Values:
        return self.is_clean(state.brushed).all(-1) | state.refusal.is_respected

    def is_failure(self, state: ToothBrushingState) -> Values:
        return state.refusal.is_hurt


@register_policy("tooth_brushing", "recipient", "cooperative")
def cooperative(env: CareEnv, role: str) -> BehaviourTree:
    """Return a recipient who looks at the brush and opens the mouth when it comes near."""
    assert isinstance(task := env.task, ToothBrushing)
    return eat_when_fed(
        task.recipient, lambda: task.state.bristles, lambda: task.state.distance, task.control_dt
    )
