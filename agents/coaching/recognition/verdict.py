"""Judges one repetition: how much of each limit it used, and from that right, nearly or wrong."""

from __future__ import annotations

import math
from collections.abc import Mapping

from .assessment import (
    ATTEMPTED,
    MUCH_MORE_ALIKE,
    Assessment,
    Motion,
    WayMeasure,
    assess,
    likeness_of,
    most,
    unevenness,
)
from .recogniser import Repetition
from .segmenter import Segment
from .template import MOVING, RATE, Template

# All our own choice.
ALIKE = 0.6  # likeness from which a movement is taken for another exercise
UNLIKE = 0.3  # below this it is no attempt at an exercise
GIVES = 1.5  # a limit gives way by so many standard deviations of what was measured
ELBOW_GIVES = (
    3.0  # that of elbows, whose bend hands tell worst: chosen on nine people of `development`
)
TOGETHER = 3.0  # shares of limits add up to the power of this: several small faults make one
# Compensation and a way that falls short add up; who is slow or goes further has done nothing wrong by half.
ADDS_UP = frozenset(
    "range direction asymmetric trunk_lean trunk_turn bent_elbows head_moved".split()
)
WIDTH = (
    0.13  # of the logistic curve from that to a probability; fitted to subjects 3 and 4 of UI-PRMD
)
# What is as good as right, with little of it to mend, is nearly right.
NEARLY = 1.25
MENDABLE = frozenset(
    """
    range too_far direction asymmetric too_fast too_slow bent_elbows trunk_lean trunk_turn head_moved
    arm_moved """.split()
)


def used_of_limits(found: Assessment) -> dict[str, float]:
    """Return how much of each limit a repetition used, by name of `ERRORS`: 0 nothing, 1 all of it.

    A limit grows with how unsure the source was, in quadrature.
    """
    demand, sd = found.demand, found.unsure
    ways = tuple(found.ways.values())
    out = {}
    short = [_range_used(way, demand.range_share, sd["arm"]) for way in ways]
    out["range"] = max(short, default=0.0)
    strayed = [way.away / _given(way.allowed, sd["arm"]) for way in ways]
    out["direction"] = max(strayed, default=0.0)
    further = max((way.beyond for way in ways), default=0.0)
    out["too_far"] = max(further, 0.0) / _given(math.radians(demand.beyond_deg), sd["arm"])
    arms = [found.ways[part] for part in ("left_arm", "right_arm") if part in found.ways]
    if len(arms) == 2:
        uneven = unevenness(arms[0].shares, arms[1].shares)
        # An arm that pauses on the way is behind at one place, one that begins later is all along.
        pairs = zip(*(arm.reached for arm in arms), strict=False)
        late = min((abs(left - right) for left, right in pairs), default=0) / RATE
        scale = max(min(arm.scale for arm in arms), 1e-3)
        allowed = _given(demand.symmetry, sd["arm"] / scale)
        out["asymmetric"] = max(uneven / allowed, late / demand.lag_s)
    # What was left out takes no time.
    if found.tempo < 1 and all(way.least > ATTEMPTED for way in ways):
        out["too_fast"] = math.log(max(found.tempo, 1e-3)) / math.log(demand.tempo[0])
    elif found.tempo > 1:
        out["too_slow"] = math.log(found.tempo) / math.log(demand.tempo[1])
    others = (
        ("trunk_lean", found.lean, demand.lean_deg, "lean"),
        ("trunk_turn", found.turn, demand.turn_deg, "turn"),
        ("bent_elbows", found.elbow, demand.elbow_deg, "elbow"),
        ("head_moved", found.head, demand.head_deg, "head"),
        ("arm_moved", found.arm, demand.still_deg, "arm"),
    )
    for name, value, limit, by in others:
        gives = ELBOW_GIVES if by == "elbow" else GIVES
        out[name] = max(value, 0.0) / _given(math.radians(limit), sd[by], gives)
    out["head_moved"] = max(out["head_moved"], found.gaze / math.radians(demand.gaze_deg))
    return out


def _given(limit: float, unsure: float, gives: float = GIVES) -> float:
    return math.hypot(limit, gives * unsure)


def _range_used(way: WayMeasure, share: float, unsure: float) -> float:
    # How far it went is the gap of two directions, each of them unsure.
    allowed = _given(1.0 - share, math.sqrt(2) * unsure / max(way.scale, 1e-3))
    return max(1.0 - way.least, 0.0) / allowed


def joined(used: Mapping[str, float]) -> float:
    """Return how much of all limits together was used: 1 is at the limit.

    At least as much as of any one limit; several faults that are each within theirs add up.
    """
    added = sum(min(value, 9.0) ** TOGETHER for name, value in used.items() if name in ADDS_UP)
    return max(added ** (1 / TOGETHER), *used.values())


def chance_of_right(used: float) -> float:
    """Return the probability that a repetition which used so much of its limits is right."""
    return 1.0 / (1.0 + math.exp(min((used - 1.0) / WIDTH, 50.0)))


def _not_the_exercise(found: Assessment, best: float) -> str:
    """Return what a movement was that is no attempt at the exercise; empty if it is one.

    Args:
        found: It against the exercise asked for.
        best: How much it is like the most alike of the other exercises there are, 0 to 1.
    """
    likeness = found.likeness
    is_other = best > ALIKE and best > likeness + MUCH_MORE_ALIKE and not found.keeps_to_path
    if not any(way.greatest > ATTEMPTED for way in found.ways.values()):
        return _not_attempted(found, best, is_other=is_other)
    if is_other:
        return "other_exercise"
    if likeness < UNLIKE and best < ALIKE and not found.keeps_to_path:
        one_sided = len(found.ways) > 1 and any(w.likeness > ALIKE for w in found.ways.values())
        if not one_sided:
            return "unknown_movement"
    return ""


def _not_attempted(found: Assessment, best: float, *, is_other: bool) -> str:
    asks_head = "head" in found.ways
    arm_moved = found.arm > math.radians(found.demand.still_deg)
    if not asks_head and arm_moved and best <= ALIKE:
        return "wrong_side"
    if asks_head and found.ways["head"].against > ATTEMPTED:
        return "wrong_side"
    if is_other or best > ALIKE:
        return "other_exercise"
    if asks_head and arm_moved:
        return "arms_only"
    if not asks_head and max(found.head, found.gaze) > math.radians(15):
        return "head_only"
    if max(way.excursion for way in found.ways.values()) > math.radians(25):
        return "unknown_movement"
    return ""


def faults(found: Assessment, used: Mapping[str, float]) -> tuple[str, ...]:
    """Return what was wrong with an attempt at the exercise, names of `ERRORS`, the one to speak of first.

    Where no limit was passed but all together are, what used most of its own is named.
    """
    ways, out = found.ways, []
    arms = [ways[part] for part in ("left_arm", "right_arm") if part in ways]
    if len(arms) == 2 and min(arm.greatest for arm in arms) < ATTEMPTED:
        out.append("one_side")
    order = ("asymmetric", "range", "too_far", "direction")
    named = [*order, *(name for name in used if name not in order)]
    for name in named:
        if used.get(name, 0.0) <= 1.0 or (name == "asymmetric" and out):
            continue
        missed = name == "range" and any(
            way.shares[0] >= ATTEMPTED > way.least for way in ways.values() if len(way.shares) > 1
        )
        out.append("part_missing" if missed else name)
    if not out and joined(used) > 1.0:
        out.append(max(used, key=lambda name: used[name]))
    return tuple(out)


def _is_next_to_nothing(found: Assessment, motion: Motion) -> bool:
    """Return whether nobody would call it a movement: somebody shifts, or looks about."""
    if any(way.greatest > ATTEMPTED for way in found.ways.values()):
        return False
    parts = [most(motion.excursion(part)) for part in MOVING]
    wrists = [motion.wrist_excursion(side) for side in ("left", "right")]
    is_small = max(parts) < math.radians(20) and max(wrists) < 0.4
    return is_small and found.lean < math.radians(10) and found.turn < math.radians(15)


def judge(
    template: Template, others: Mapping[str, Template], segment: Segment
) -> Repetition | None:
    """Judge a repetition; None if hardly anything moved.

    Args:
        template: The exercise asked for.
        others: The other exercises there are, by name.
        segment: What was seen.
    """
    motion = Motion.of(segment)
    found = assess(template, motion)
    if _is_next_to_nothing(found, motion):
        return None
    measures = found.measures()
    span = (segment.start, segment.end)
    if found.unseen:
        return Repetition(*span, False, ("not_seen",), 0.0, measures)
    best = 0.0
    if found.likeness < 1 - MUCH_MORE_ALIKE:  # else no other can be more alike
        best = max((likeness_of(other, motion) for other in others.values()), default=0.0)
    instead = _not_the_exercise(found, best)
    if instead:
        return Repetition(*span, False, (instead,), 0.0, measures)
    used = used_of_limits(found)
    errors = faults(found, used)
    together = joined(used)
    if not segment.returned and not errors:
        errors, together = ("too_slow",), max(together, NEARLY)
    if set(errors) - MENDABLE:
        together = max(together, 2 * NEARLY)
    return Repetition(
        *span,
        not errors,
        errors,
        round(chance_of_right(together), 3),
        measures,
        nearly=bool(errors) and together < NEARLY,
        used=used,
    )
