"""A hand-written robot that lays an arm on the armrest with a cradle.

It goes behind the forearm from outside and lifts it in an arc about the elbow, which gives way slowly and
is pushed ahead by it. Once the hand is clear of the armrest it carries the forearm over it, and holds the
wrist high there: under a steep forearm the elbow swings back, until the arm, let go, would come to its place.
Then it goes down faster than the arm sinks, levels the plate, and is drawn out from under it. It yields where
it presses, keeps over lap and belly, does not begin with an arm that may not be borne, and begins anew if the
arm does not stay. What it does it tells by where arm and plate are; it keeps in mind only whether the elbow
has swung back, and whether it lets go, of an arm that is up.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rcare_marl.agents.people.body.skeleton import JOINT_INDEX
from rcare_marl.envs.devices import HOOK_SHARE_HANGING
from rcare_marl.envs.registry import register_policy
from rcare_marl.envs.scenes.limb_repositioning_state import LAP_SEEN
from rcare_marl.envs.tasks.limb_repositioning import LimbRepositioning
from rcare_marl.pose import (
    Array,
    Pose,
    multiply,
    quaternion_from_matrix,
    quaternion_from_rpy,
    rotate,
)

from .tool_script import ToolScript, limited, turning, unit

# All our own choices.
GAIN, TURN_GAIN = 3.0, 3.0  # [1/s]
FAST, SLOW = 0.2, 0.1  # [m/s] freely, and near or under the arm
LEAVING = 0.4  # [m/s] from under the arm: the faster, the less it takes along
TIPPED = (
    0.22  # [rad] that its tip is lower as it leaves: the arm slides off, about as friction holds it
)
LEVEL = 0.05  # of the tip below the root, as a sine, from where it leaves
NEAR = 0.02  # [m] from a place that counts as reached
STILL, SLOWLY = 0.03, 0.005  # [m/s] of the wrist of an arm that hangs still, and that sinks no more
DOWN = 0.1  # [m] of the wrist under its place, of an arm that hangs: nothing is kept in mind of it
# [m] from the plate to where it holds an arm that hangs, at most, and one that is up; else that slipped off.
HELD, LOST = 0.045, 0.08
# [rad] that a forearm is led ahead of itself: out from behind the armrest, up, over the pad, and down.
PUSHED, LIFTED, SWAYING, SINKING = 0.25, 0.2, 0.2, 0.13
# [m] of the elbow before the armrest's rear end, when the forearm is free of it, and how much less a second
# from EARLY [s] on.
FREE, RELENTING, EARLY = 0.03, 0.008, 3.0
PRESS = 0.015  # [m] that the plate aims into the arm as it slides along it
PRESSING = ("approach", "free", "slide", "lift", "sway", "lower")
TURNING = (*PRESSING, "drop")
# Where the forearm points: while the elbow is behind the armrest, beside it, and over it.
OUTWARD, BESIDE, ALONG = (0.58, 0.8, 0.1), (0.93, 0.35), (1.0, 0.0)
# Where along the forearm the plate holds it, from elbow to wrist: nearest and farthest, and first. It is
# nearest where the elbow is FULL [m] farther ahead than KEPT [m], and farthest where it is as much farther
# back. Friction takes the arm along.
NEAREST, FARTHEST, FIRST = 0.8, 0.85, 0.8
KEPT, FULL = 0.03, 0.04
# [rad] of the wrist above the elbow: to which it is lifted, and so level that it is let go.
PITCH, LEVELLED = 0.5, 0.1
ENOUGH = 0.02  # [m] farther back than SWAYED, from where it is not lifted higher
RISE = 0.038  # [m] of the elbow over its place, while the forearm is lifted
RISING = 0.008  # [m] that the elbow is led up, while a level forearm is too low
CLEAR = 0.04  # [m] of the wrist over its place, before it goes over the armrest; over it, less
ROOM = 0.01  # [m] between plate, or hand, and armrest
# What hangs in the air swings back at the shoulder, until it lies: by SWINGS of the height of the wrist [1].
# It is lowered from where it so comes to lie SWAYED ahead of its place, or LATE [s] before the end, and let
# go where it comes to lie LANDS ahead [m], or LATEST [s] before the end.
SWINGS, LANDS, SWAYED, LATE, LATEST = 0.4, 0.01, -0.01, 6.0, 3.5
ABOVE = 0.015  # [m] between plate and belly or thighs
UNDER, HOVER = 0.012, 0.04  # [m] of the plate over the pad, at least, and as it yields
EASY, SOFT = 0.5, 0.0015  # of the force limit, from which the plate is lower, and by how much [m/N]
# [m] from hand to robot, from where it lifts more slowly, and how much more.
CLOSE, SLOWER = 0.02, 0.5
YIELDING = (0.4, 0.9)  # of the force limit: where it gets slower, and where it goes back
AWAY = 0.2  # [m] that the plate is drawn out
SPIN = 0.8  # [rad/s] of the plate at the arm
# [m] outside of the arm, where the plate passes it, if it is so much higher or lower
ASIDE, ROUND = 0.15, 0.1
# [m] from its place, from where an arm on the pad creeps there by itself, or stays, and one that is not on it
LYING, NEARLY = 0.08, 0.06
LEAN = 4.0  # [N] on the pad, of an arm that lies there
AFLOAT = 0.045  # [m] over or below its place, of one whose hand lies on the thigh: a new try runs into it
# Whose shoulder holds on, as by muscles, comes to lie with the hand on the thigh, unless the hand, so much of
# the forearm beyond the wrist, is let go over the pad's middle; the plate goes out under it by SLIP [m].
HAND_AHEAD, SLIP = 0.5, 0.015
# [m] that an arm would come to lie behind its place, from where the plate takes it ahead, and how far.
BEHIND, TAKEN = 0.03, 0.04
CENTRED = 0.01  # [m] from its place across the pad, where it may be let go
INSIDE = 0.006  # [m] of its place, where it is let go: the plate takes it out with it
OVER = 0.035  # [m] from there, where the armrest is below it still
FINGERS = ("index", "middle", "ring", "pinky", "thumb")
HAND = ("left_wrist", *(f"left_{name}{k}" for name in FINGERS for k in (1, 2, 3)))


@register_policy("limb_repositioning", "robot", "scripted")
class ScriptedRepositioning(ToolScript[LimbRepositioning]):
    """Goes behind the forearm, lifts, carries and lowers it, and draws the plate out; sees everything."""

    KIND = LimbRepositioning

    def _begin(self) -> None:
        self.phase, self._wrist = "approach", np.zeros(3)
        self._has_swung = self._lets_go = False

    def act(self) -> Array:
        if not self._task.feasible.holds:  # nobody lifts what may not be borne
            return self._robot.tool_action(np.zeros(3), np.zeros(3))
        seat = self._task.seat_pose()
        place = np.array(seat.position)
        self.phase = self._see(seat)
        goal, turn, limit = getattr(self, "_" + self.phase)(place)
        self._wrist = self._task.state.wrist
        if self.phase in ("slide", "lift"):
            goal = self._outside(seat, goal, turn)
        if self.phase in ("lift", "sway", "lower", "drop"):
            goal[2] = max(float(goal[2]), self._over_lap())
        return self._towards(seat, goal, turn, limit)

    def memory(self) -> tuple[Sequence[object], Array]:
        return (self._has_swung, self._lets_go), np.zeros(0)

    def recall(self, holds: Sequence[bool]) -> None:
        self._has_swung, self._lets_go = holds

    def _see(self, seat: Pose) -> str:
        """Return the phase, by where arm and plate are, and by what is kept in mind of an arm that is up."""
        task, state = self._task, self._task.state
        height, aside = float(state.wrist[2] - state.target[2]), -float(state.gap[1])
        lands, left = self._lands(), task.time_limit - state.time
        is_low = state.plate[2] < max(self._floor(), self._over_lap()) + 0.5 * NEAR
        if height < -DOWN:
            self._has_swung = self._lets_go = False
        if self._has_swung and not self._lets_go:
            is_level = self._direction()[2] < LEVELLED
            lies = (is_low or is_level or lands > LANDS) and self._is_over_pad()
            self._lets_go = bool(lies or left < LATEST)
        holds = self._holds(state.plate)
        if height > -DOWN and not holds and aside < OVER and self._is_out_of_reach():
            self._lets_go = True
        if self._lets_go and self._is_to_fetch():
            self._has_swung = self._lets_go = False
        if self._lets_go:
            tip = rotate(seat.quaternion, (0.0, 0.0, 1.0))[2]
            return "leave" if tip < -LEVEL else "drop"
        if not holds:
            return "approach"
        free = FREE - RELENTING * max(state.time - EARLY, 0.0)
        if height < -DOWN and state.past_end < free:
            return "free"
        if height < 0 and self._share_of(state.plate) < FIRST - NEAR / self._length():
            return "slide"
        part = min(max((aside - CENTRED) / (OVER - CENTRED), 0.0), 1.0)
        if part > 0 and not (height > part * CLEAR and self._hand_over_pad() > part * ROOM):
            return "lift"
        if (lands < SWAYED and self._is_over_pad()) or (aside < OVER and left < LATE):
            self._has_swung = True
        return "lower" if self._has_swung else "sway"

    def _outside(self, seat: Pose, goal: Array, turn: Array) -> Array:
        """Keep the tip of the plate from going under the armrest [m], shape [3]."""
        chair = self._task.chair
        pad = chair.frame_in_world("armrest_left").position
        half = 0.5 * self._task.cradle.model.figure("plate_length")
        now = seat.position[2] + half * rotate(seat.quaternion, (0.0, 0.0, 1.0))[2]
        if now > pad[2] + ROOM:
            return goal
        tip = goal[1] + half * rotate(turn, (0.0, 0.0, 1.0))[1]
        lacking = pad[1] + 0.5 * chair.armrest_size[1] + ROOM - tip
        return np.asarray(goal + (0.0, max(float(lacking), 0.0), 0.0))

    def _approach(self, seat: Array) -> tuple[Array, Array, float]:
        """Go behind the forearm from outside, along a line, once the arm is still."""
        place, turn = self._task.hook()
        wrist = self._task.state.wrist
        inward = rotate(turn, (0.0, 0.0, 1.0))
        back = rotate(turn, (-1.0, 0.0, 0.0))
        first, last = place - 0.11 * inward + 0.03 * back, place + 0.015 * back
        way = (last - first) / math.dist(last, first)
        beside = float(np.linalg.norm(seat - first - (seat - first) @ way * way))
        if beside < NEAR:
            return last, turn, SLOW
        if not self._is_still(STILL):  # it may swing back into the way
            return seat, turn, SLOW
        if abs(float(first[2] - seat[2])) > ROUND:  # round the arm, and not through it
            aside = ASIDE + max(float(wrist[1]), float(self._task.state.elbow[1]))
            if seat[1] < aside - NEAR:
                return np.array((seat[0], aside, seat[2])), turn, FAST
            first[1] = aside
        return first, turn, FAST

    def _is_still(self, speed: float) -> bool:
        return math.dist(self._task.state.wrist, self._wrist) < speed * self._task.control_dt

    def _direction(self) -> Array:
        along = self._task.state.wrist - self._task.state.elbow
        return np.asarray(along / np.linalg.norm(along))

    def _length(self) -> float:
        return math.dist(self._task.state.wrist, self._task.state.elbow)

    def _share_of(self, place: Array) -> float:
        """Return how far from elbow to wrist a place is."""
        return float((place - self._task.state.elbow) @ self._direction()) / self._length()

    def _holds(self, place: Array) -> bool:
        """Return whether the plate is behind the forearm, or under it."""
        share = self._share_of(place)
        near = LOST if self._task.state.wrist[2] > self._task.state.target[2] - DOWN else HELD
        return math.dist(self._task.hook(share)[0], place) < near

    def _led(self, towards: Sequence[float], lead: float) -> Array:
        """Return the direction of the forearm, turned to another by an angle [rad] at most."""
        now, wished = self._direction(), unit(np.array(towards))
        left = math.acos(min(max(float(wished @ now), -1.0), 1.0))
        part = min(1.0, lead / max(left, 1e-6))
        return unit((1 - part) * now + part * wished)

    def _free(self, seat: Array) -> tuple[Array, Array, float]:
        """Push the forearm out from behind the armrest."""
        share = min(max(self._share_of(seat), HOOK_SHARE_HANGING), FIRST)
        place, turn = self._task.hook(share)
        ahead = self._led(OUTWARD, PUSHED) - self._direction()
        return place + share * self._length() * ahead, turn, SLOW

    def _slide(self, seat: Array) -> tuple[Array, Array, float]:
        """Slide the plate towards the wrist."""
        place, turn = self._task.hook(FIRST)
        return place + PRESS * rotate(turn, (1.0, 0.0, 0.0)), turn, SLOW

    def _raised(self, way: Sequence[float], pitch: float, lead: float) -> tuple[Array, Array]:
        """Return where the plate holds a forearm that is led a way, raised by `pitch` [rad], and its turn.

        The plate slides along it, so that friction takes the elbow to where it is wished; and it gives way to
        what weighs on it.
        """
        task, state = self._task, self._task.state
        forearm = self._led((*way, math.tan(pitch)), lead)
        elbow = state.elbow.copy()
        if self.phase == "lift":
            elbow[2] = max(
                float(elbow[2]) + (RISING if forearm[2] > -0.12 else 0.0), state.target[2] + RISE
            )
        back = min(max((self._ahead_by() - KEPT) / FULL, -1.0), 1.0)
        share = 0.5 * (NEAREST + FARTHEST) - 0.5 * (FARTHEST - NEAREST) * back
        place, turn = task.cradle.under(elbow, elbow + self._length() * forearm, task.radius, share)
        hovering = min(float(place[2]), self._floor() + HOVER)
        place[2] -= SOFT * max(state.force - EASY * task.force_limit, 0.0)
        place[2] = max(float(place[2]), hovering)
        return place, turn

    def _over_lap(self) -> float:
        """Return how low the plate goes over belly and thighs [m]."""
        gap = self._task.state.lap_gap
        return float(self._task.state.plate[2]) + ABOVE - gap if gap < LAP_SEEN else -math.inf

    def _hand_over_pad(self) -> float:
        """Return how high the hand is over the armrest that it would be caught at [m]."""
        task, person = self._task, self._task.recipient
        pad = task.chair.frame_in_world("armrest_left").position
        least = math.inf
        for joint in HAND:
            frame = person.joint_pose(joint).matrix()
            for shape in person.segments[joint].shapes:
                turn = np.abs(frame[:3, :3] @ shape.rotation)
                is_box = shape.kind == "box"
                half = 0.5 * turn @ shape.size if is_box else 0.5 * shape.size[0] * turn[:, 2]
                x, _, z = frame[:3, :3] @ shape.centre + frame[:3, 3] - half
                if x < pad[0] + 0.5 * task.chair.armrest_size[0]:
                    least = min(least, float(z) - pad[2] - (0.0 if is_box else shape.size[-1]))
        return least

    def _floor(self) -> float:
        """Return how low the plate goes over the pad [m]."""
        return float(self._task.state.target[2]) - self._task.radius + UNDER

    def _lift(self, seat: Array) -> tuple[Array, Array, float]:
        """Swing the forearm up, and steeper, until the elbow is where it swings back from to its place."""
        goal, turn = self._raised(BESIDE, PITCH, LIFTED)
        goal[1] = min(float(goal[1]), float(self._task.hook(self._share_of(seat))[0][1]))
        return goal, turn, SLOW

    def _sway(self, seat: Array) -> tuple[Array, Array, float]:
        """Bring it over the pad, and hold it steeply there, until the elbow will swing back to its place."""
        steep = min(max(1.0 + (self._lands() - SWAYED) / ENOUGH, 0.0), 1.0)
        pitch = math.asin(self._direction()[2])
        goal, turn = self._raised(ALONG, pitch + steep * (PITCH - pitch), SWAYING)
        return self._over(seat, goal), turn, SLOW

    def _lower(self, seat: Array) -> tuple[Array, Array, float]:
        """Lower it, until the elbow will swing back to its place when the plate is gone."""
        goal, turn = self._raised(ALONG, 0.0, SINKING)
        return self._over(seat, goal), turn, SLOW

    def _over(self, seat: Array, goal: Array) -> Array:
        """Return where the plate goes to bring the forearm over its place, and ahead if far behind [m]."""
        ahead = min(max(-BEHIND - self._lands(), 0.0), TAKEN)
        return np.array((goal[0] + ahead, seat[1] + self._aside(float(goal[1] - seat[1])), goal[2]))

    def _aside(self, under: float) -> float:
        """Return how far out the plate goes to bring the forearm over the pad, and the hand off the lap [m].

        Args:
            under: How far out the middle of the plate would be under the forearm [m].
        """
        state = self._task.state
        hand = state.wrist + HAND_AHEAD * (state.wrist - state.elbow)
        return max(
            float(state.gap[1]) - INSIDE, min(float(state.target[1] - hand[1]), under + SLIP)
        )

    def _is_over_pad(self) -> bool:
        """Return whether the plate has brought the forearm over the pad, neither too far out nor in."""
        under = float((self._raised(ALONG, 0.0, SINKING)[0] - self._task.state.plate)[1])
        return abs(self._aside(under)) < CENTRED

    def _drop(self, seat: Array) -> tuple[Array, Array, float]:
        """Take the plate down, faster than the forearm sinks: the elbow swings back, as nothing holds it."""
        low = max(self._floor(), self._over_lap())
        now = self._task.seat_pose().quaternion
        turn = _turned(TIPPED) if seat[2] < low + 0.5 * NEAR else np.array(now)
        return np.array((*seat[:2], low)), turn, LEAVING

    def _lands(self) -> float:
        """Return how far ahead of its place the forearm would come to lie if it were let go now [m]."""
        state = self._task.state
        return self._ahead_by() - SWINGS * float(state.wrist[2] - state.target[2])

    def _ahead_by(self) -> float:
        """Return how far ahead of its place a level forearm with this elbow would lie [m]."""
        state = self._task.state
        length = math.dist(state.wrist, state.elbow)
        return float(state.elbow[0] + 0.5 * length - state.target[0])

    def _leave(self, seat: Array) -> tuple[Array, Array, float]:
        """Draw the plate out, and stay away."""
        half = 0.5 * self._task.cradle.model.figure("plate_length")
        out = (seat[0], self._task.state.target[1] + AWAY, self._floor() + half * math.sin(TIPPED))
        return np.array(out), _turned(TIPPED), LEAVING

    def _is_to_fetch(self) -> bool:
        """Return whether an arm that was let go lies still elsewhere, where the cradle comes behind it."""
        state = self._task.state
        is_out = state.plate[1] > state.target[1] + AWAY - NEAR
        if not is_out or not self._is_still(SLOWLY) or state.rested > 0 or state.distance < NEARLY:
            return False
        return not self._is_out_of_reach()

    def _is_out_of_reach(self) -> bool:
        """Return whether the cradle cannot fetch the arm: it lies inside of the armrest, or on the pad."""
        state, width = self._task.state, self._task.chair.armrest_size[1]
        lies = state.distance < LYING and (state.pad_force >= LEAN or abs(state.gap[2]) < AFLOAT)
        return bool(lies or state.wrist[1] < state.target[1] - 1.5 * width)

    def _towards(self, seat: Pose, goal: Array, turn: Array, limit: float) -> Array:
        velocity = limited(GAIN * (goal - seat.position), limit) * self._eagerness()
        middle = np.array(seat.position)  # of the plate, about which it turns
        spin = turning(turn, seat.quaternion, TURN_GAIN)
        if self.phase in TURNING:
            spin = limited(spin, SPIN) * max(self._eagerness(), 0.0)
        return self._about(middle, velocity, spin)

    def _eagerness(self) -> float:
        """Return the share of its speed with which it goes on, less the more it presses; negative: back."""
        if self.phase not in PRESSING:
            return 1.0
        task = self._task
        low, high = np.multiply(YIELDING, task.force_limit)
        eager = float(np.clip((high - task.state.force) / (high - low), -1.0, 1.0))
        if self.phase not in ("lift", "sway"):
            return eager
        forearm = task.recipient.frames[JOINT_INDEX["left_elbow"]].link
        apart, links = task.world.separation, (forearm, None)
        gap = apart(task.recipient.body, task.robot.body, within=CLOSE, links=links)
        return eager * (
            1.0 if gap >= CLOSE else SLOWER
        )  # else the hand is knocked against the robot


def _turned(tip: float) -> Array:
    """Return how the plate is turned, along the armrest, with its tip lower by an angle [rad]."""
    level = np.column_stack(((0.0, 0.0, 1.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0)))
    return np.array(multiply(quaternion_from_rpy(tip, 0.0, 0.0), quaternion_from_matrix(level)))
