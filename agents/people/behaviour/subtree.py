"""Reusable pieces of behaviour: each function returns a tree of its own, to be composed.

They are reactive: ticked once a control step, every condition is asked anew, and whatever has a higher
place in a tree interrupts what is below. They keep no state but their own, so any number of people can
be in one process.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
from py_trees import composites
from py_trees.behaviour import Behaviour

from rcare_marl.pose import conjugate, rotate

from ...agent import Array
from ..body.skeleton import JOINT_INDEX, SIDES
from ..human import Human
from ..physiology_model import physiology_model
from .behaviour_tree import OPENING, closed_or_chewing, look_at
from .cue import GESTURES
from .leaves import (
    Act,
    Actor,
    Condition,
    Follow,
    Freeze,
    LetGo,
    Pulse,
    Pursue,
    Settle,
    Threshold,
    Withdraw,
    first_of,
    together,
    when,
)

# All our own choices.
COUGHS, COUGH_PERIOD = 3, 0.8  # [s]
COUGH_DEPTH = {
    "neck_flexion": 0.16,
    "head_flexion": 0.10,
    "spine1_flexion": 0.10,
    "spine2_flexion": 0.08,
}
GAZES = ("abduction", "elevation")
AVERT, CHIN_UP = 0.45, -0.08  # [rad] of neck and of head each: turned away, and back
FACING = math.radians(35)  # between face and speaker: from there the eyes look, which turn by 45
OPEN_ENOUGH = 0.5  # of the wished opening: a mouth that is called open
LEAVING = 0.03  # [m] further than where the mouth opens for a spoon, it closes again
UNWINDING = 3.0  # [s] in which the tired lower their limbs before they let go

# By how much a limb withdraws [rad]: legs and arms bend as in the flexor reflex.
RETREATS: dict[str, dict[str, float]] = {
    "arm": {"elbow_flexion": 0.6, "shoulder_flexion": -0.3, "collar_elevation": 0.15},
    "leg": {"hip_flexion": 0.35, "knee_flexion": 0.5},
    "neck": {"neck_flexion": -0.2, "head_flexion": -0.15},
    "trunk": {"spine1_flexion": 0.15, "spine2_flexion": 0.12},
}
BRACE = {
    "neck_flexion": 0.12,
    "head_flexion": 0.1,
    "left_elbow_flexion": 0.3,
    "right_elbow_flexion": 0.3,
    "left_collar_elevation": 0.15,
    "right_collar_elevation": 0.15,
}


ARMS = tuple(f"{side}_{joint}" for side in ("left", "right") for joint in ("shoulder", "elbow"))
LIMBS = (
    *ARMS,
    *(f"{s}_{j}" for s in ("left", "right") for j in ("collar", "wrist", "hip", "knee", "ankle")),
    "spine",
)
LARGE = {
    f"{side}_{dof}"
    for side in ("left", "right")
    for dof in ("shoulder_flexion", "elbow_flexion", "hip_flexion", "knee_flexion")
} | {"neck_flexion", "neck_rotation_left"}


def hold_still(actor: Actor) -> Freeze:
    """Return: keep every DoF where it is."""
    dofs = [dof for dof in actor.person.movable if actor.can_move(dof)]
    return Freeze("hold still", actor, dofs)


def relax(actor: Actor) -> LetGo:
    """Return: wish nothing any more."""
    return LetGo("let go", actor.intent)


def reach(actor: Actor) -> Behaviour:
    """Return: go for the angles of `cues.reach` while there are any."""

    def wish() -> Mapping[str, float]:
        return actor.able(actor.cues.reach()) if actor.cues.reach is not None else {}

    aims = Condition("has something to reach", lambda: actor.cues.reach is not None)
    return when("reach", aims, Pursue("reach for it", actor, wish))


def instructed(actor: Actor, text: str, step: Behaviour) -> Behaviour:
    """Return: go on with a step that never ends while one sentence is in force; done at once."""
    instruction = actor.cues.instruction

    def done() -> None:
        instruction.answer = "done"

    heard = Condition("is asked to", lambda: instruction.is_asked(text))
    return when(text, heard, Act("say done", done), step)


def follow(actor: Actor, part: str) -> list[Behaviour]:
    """Return a branch for each sentence about a part that this person can do something about."""
    branches: list[Behaviour] = []
    for text, gesture in GESTURES.items():
        if gesture.part == part and gesture.angles and actor.can_reach(gesture.angles):
            branches.append(Follow(text, actor, actor.able(gesture.angles).copy))
    return branches


def mouth(
    actor: Actor,
    gap: Callable[[], float] | None,
    *,
    opens_within: float,
    opening: float = OPENING,
    is_full: Callable[[], bool] = lambda: False,
) -> Behaviour | None:
    """Return: open the mouth when asked or when the spoon is near, else keep it closed, or chew.

    Args:
        actor: Whose mouth it is.
        gap: Returns the distance from spoon to mouth [m]; None where there is no spoon.
        opens_within: Distance below which the mouth opens [m]; it closes a little beyond.
        opening: Share of the active range that it opens.
        is_full: Returns whether something is in the mouth: then it opens for no spoon.
    """
    jaw = "jaw_opening"
    if not actor.can_move(jaw):
        return None
    highest = float(actor.person.active[actor.person.movable.index(jaw), 1])
    wide = {jaw: highest * opening}
    branches = follow(actor, "mouth")

    def is_open() -> bool:
        return actor.person.angle(jaw) >= OPEN_ENOUGH * wide[jaw]

    branches.insert(0, Follow("open your mouth", actor, lambda: wide, is_done=is_open))
    if gap is not None:
        near = Threshold(
            "spoon is near",
            lambda: -gap(),
            actor.clock,
            begins=-opens_within,
            ends=-opens_within - LEAVING,
        )
        free = Condition("mouth is empty", lambda: not is_full())
        opened = Pursue("open the mouth", actor, lambda: wide)
        branches.append(when("take the food", near, free, opened))

    def closed() -> Mapping[str, float]:
        return {jaw: closed_or_chewing(is_full, actor.clock)}

    branches.append(Pursue("close the mouth", actor, closed))
    return first_of("mouth", *branches)


def gaze(person: Human, point: Callable[[], Array]) -> Callable[[], dict[str, float]]:
    """Return the angles of the eyes that look at a point in the world [m]."""
    eyes = [side for side in ("left", "right") if f"{side}_eye_abduction" in person.movable]
    frame = person.frames[JOINT_INDEX["head"]]

    def wish() -> dict[str, float]:
        way = point() - person.mouth_position()
        head = person.body.link_pose(frame.link).quaternion
        left, up, ahead = frame.rotation.T @ rotate(conjugate(head), way)
        yaw, pitch = math.atan2(left, ahead), math.atan2(up, math.hypot(left, ahead))
        angles = {}
        for side in eyes:  # abduction turns each eye outwards
            angles[f"{side}_eye_abduction"] = yaw if side == "left" else -yaw
            angles[f"{side}_eye_elevation"] = pitch
        return angles

    return wish


def look(actor: Actor, point: Callable[[], Array] | None) -> Behaviour | None:
    """Return: turn the head and the eyes as asked, else to a point in the world [m]."""
    instruction, branches = actor.cues.instruction, follow(actor, "head")
    has_eyes = any(actor.can_move(f"{side}_eye_{way}") for side in SIDES for way in GAZES)
    if not branches and (point is None or not has_eyes):
        return None

    def speaker() -> Mapping[str, float]:
        assert instruction.speaker is not None  # else the sentence cannot be followed
        return _towards(actor, instruction.speaker)()

    def is_facing() -> bool:
        assert instruction.speaker is not None
        mouth, face = actor.person.mouth_and_face()
        way = instruction.speaker() - mouth
        return float(face @ way) >= math.cos(FACING) * float(np.linalg.norm(way))

    branches.insert(0, Follow("look at me", actor, speaker, is_done=is_facing))
    if point is not None:
        branches.append(Pursue("watch", actor, _towards(actor, point)))
    else:
        rest = actor.start("neck", "head")
        branches.append(Pursue("face ahead", actor, lambda: rest))
    return first_of("look", *branches)


def _towards(actor: Actor, point: Callable[[], Array]) -> Callable[[], Mapping[str, float]]:
    """Return the angles of head and eyes that look at a point in the world [m]."""
    head, eyes = look_at(actor.person, point), gaze(actor.person, point)
    return lambda: actor.able(head() | eyes())


def limbs(actor: Actor, *, has_job: bool = False) -> Behaviour | None:
    """Return: move arms, legs and trunk as asked, or reach, else do one's job or rest as at the start.

    Args:
        actor: Whose limbs they are.
        has_job: Whether the scene has something to do for the person, see `Surroundings`.
    """
    work = Act("do the job", lambda: setattr(actor.deed, "works", True))
    rest = actor.start(*LIMBS)
    if not rest:
        return work if has_job else None
    last = work if has_job else Pursue("rest the limbs", actor, lambda: rest)
    back = {"lower your arms": ARMS, "sit back": ("spine",)}
    branches = follow(actor, "limbs")
    for text, prefixes in back.items():
        angles = actor.start(*prefixes)
        if angles:
            branches.append(Follow(text, actor, angles.copy))
    return first_of("limbs", *branches, reach(actor), last)


def flinch(actor: Actor, *, pain: float) -> Behaviour | None:
    """Return: withdraw the segment that hurts while pain is at least `pain` of ten, until half of it.

    Where that segment cannot move, or no contact makes the pain, the person braces with what can.
    """
    model, person = physiology_model(), actor.person

    def retreat(segment: str | None) -> Mapping[str, float]:
        moves: Mapping[str, float] = {}
        if segment is not None:
            region = model.region(segment)
            side, _, group = region.rpartition("_")
            moves = {f"{side}_{dof}" if side else dof: by for dof, by in RETREATS[group].items()}
        able = {dof: by for dof, by in moves.items() if actor.can_move(dof)}
        return able or {dof: by for dof, by in BRACE.items() if actor.can_move(dof)}

    if not retreat(None) and not any(retreat(joint) for joint in JOINT_INDEX):
        return None
    hurts = Threshold(
        "in pain", lambda: person.physiology.pain, actor.clock, begins=pain, ends=0.5 * pain
    )
    return when("flinch", hurts, Withdraw("withdraw", actor, retreat))


def refuse(actor: Actor, source: Callable[[], Array] | None = None) -> Behaviour | None:
    """Return: while `cues.refuses`, say no, turn the head away from what is offered, close the mouth.

    Args:
        actor: Who refuses.
        source: Returns where the offer is in the world [m]; without it the head turns to the left.
    """
    person, branches = actor.person, list[Behaviour]()

    def averted() -> Mapping[str, float]:
        away = 1.0
        if source is not None:
            base = conjugate(person.body.base_pose().quaternion)
            away = -1.0 if rotate(base, source() - person.mouth_position())[0] > 0 else 1.0
        turn = {f"{joint}_rotation_left": away * AVERT for joint in ("neck", "head")}
        return actor.able(turn | {"neck_flexion": CHIN_UP, "head_flexion": CHIN_UP})

    if any(actor.can_move(f"{joint}_rotation_left") for joint in ("neck", "head")):
        branches.append(Pursue("turn away", actor, averted))
    if actor.can_move("jaw_opening"):
        branches.append(Pursue("press the lips", actor, lambda: {"jaw_opening": 0.0}))
    if "speak" in person.moves:
        branches.append(Act("say no", lambda: setattr(actor.deed, "says_no", True)))
    if not branches:
        return None
    refuses = Condition("does not want it", lambda: actor.cues.refuses)
    return when("refuse", refuses, together("turn away and close", *branches))


def cough(actor: Actor) -> Behaviour | None:
    """Return: when `cues.must_cough`, some short bends of neck and trunk, which clear it."""
    depth = {dof: by for dof, by in COUGH_DEPTH.items() if actor.can_move(dof)}
    if not depth:
        return None

    def relieved() -> None:
        actor.cues.must_cough = False

    burst = Pulse(
        "bend and straighten", actor, depth, count=COUGHS, period=COUGH_PERIOD, after=relieved
    )
    return when("cough", Condition("must cough", lambda: actor.cues.must_cough), burst)


def rest_when_tired(actor: Actor, *, tired: float, rested: float) -> Behaviour:
    """Return: from fatigue `tired` until `rested`, lower the limbs and the head, then let go.

    Once they have let go they stay so, wherever slack limbs sink to, until rested or interrupted.
    """
    physiology = actor.person.physiology
    posture = actor.start(*LIMBS, "neck", "head") | actor.able({"jaw_opening": 0.0})
    is_tired = Threshold(
        "tired", lambda: physiology.fatigue, actor.clock, begins=tired, ends=rested
    )
    back = Settle("go back to rest", actor, lambda: posture, patience=UNWINDING, judged=LARGE)
    unwind = composites.Sequence("unwind", memory=True, children=[back, relax(actor)])
    return when("rest", is_tired, unwind)
