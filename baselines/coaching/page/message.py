"""What the page may say to the server: strictly read, one dataclass each.

A message is a JSON object of at most `LARGEST` bytes with exactly the fields of its type. Numbers are finite
and within bounds. Whatever is not so is refused; nothing of it is used.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

from rcare_marl.agents.coaching.sources.body_fit import BodyFit
from rcare_marl.agents.coaching.sources.landmark_source import COUNT
from rcare_marl.errors import ConfigError

from ...pages.strict import LARGEST as LARGEST
from ...pages.strict import MessageError as MessageError
from ...pages.strict import (
    Reader,
    field_of,
    flag,
    number,
    numbers,
    one_of,
    or_null,
    parse_as,
    whole,
)

ROOM = 50.0  # nothing that is tracked is further from the origin [m]
LONGEST = 1e8  # greatest time on a page's clock, three years [s]
UNIT = 0.01  # by how much the length of a quaternion may differ from 1
STATURE = (0.8, 2.3)  # of people at the page [m]
LIFT_DEG, TURN_DEG = (10.0, 180.0), (5.0, 90.0)
TEMPO = (0.5, 1.5)
REPETITIONS = (1, 20)

Source = Literal["hands", "simulated", "landmarks"]
Mistake = Literal["none", "half_range", "one_side", "wrong_plane", "trunk_lean", "still"]
Wish = Literal["pause", "resume", "skip", "rest", "stop", "recentre"]
SOURCES: tuple[Source, ...] = get_args(Source)
MISTAKES: tuple[Mistake, ...] = get_args(Mistake)
WISHES: tuple[Wish, ...] = get_args(Wish)


@dataclass(frozen=True)
class Place:
    """A rigid pose in the frame of WebXR: x right, y up, -z ahead.

    Attributes:
        position: [m].
        quaternion: x, y, z, w, of length 1.
    """

    position: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]


@dataclass(frozen=True)
class HandJoints:
    """Four joints of a hand in the frame of WebXR [m].

    Attributes:
        wrist: The wrist.
        index: The knuckle of the index finger.
        middle: That of the middle finger.
        pinky: That of the little finger.
    """

    wrist: tuple[float, float, float]
    index: tuple[float, float, float]
    middle: tuple[float, float, float]
    pinky: tuple[float, float, float]


MOST_EXERCISES = 50  # of a session
FILE_NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")
EXERCISE_NAME = re.compile(r"[^/\\\x00-\x1f]{1,80}")


def _exercises(value: Any, name: str) -> tuple[str, ...]:
    """Take names, which the room knows or not: no path is among them."""
    if not isinstance(value, list) or not 1 <= len(value) <= MOST_EXERCISES:
        raise MessageError(f"{name} are a list of 1 to {MOST_EXERCISES} names")
    if not all(isinstance(each, str) and EXERCISE_NAME.fullmatch(each) for each in value):
        raise MessageError(f"{name} are names of exercises")
    names = tuple(value)
    if len(set(names)) != len(names):
        raise MessageError("an exercise is named twice")
    return names


def _hand(value: Any, name: str) -> HandJoints | Place:
    if not isinstance(value, dict) or len(value) != 1:
        raise MessageError(f"{name} is null or has either joints or a grip")
    if "grip" in value:
        return _place(value["grip"], f"{name}.grip")
    if "joints" not in value:
        raise MessageError(f"{name} is null or has either joints or a grip")
    joints = value["joints"]
    if not isinstance(joints, list) or len(joints) != 4:
        raise MessageError(f"{name}.joints are four points: wrist and three knuckles")
    wrist, index, middle, pinky = (_point(joint, f"{name}.joints") for joint in joints)
    for knuckle in (index, middle, pinky):
        # A hand of a child and of a giant: a source that says otherwise has lost it.
        if not 0.01 < math.dist(wrist, knuckle) < 0.3:
            raise MessageError(f"{name}.joints lie 0.01 to 0.3 m from the wrist")
    if math.dist(index, pinky) < 0.005:
        raise MessageError(f"{name}.joints have knuckles in one place")
    return HandJoints(wrist, index, middle, pinky)


def _of_landmarks(reader: Reader) -> Reader:
    def read(value: Any, name: str) -> tuple[Any, ...]:
        if not isinstance(value, list) or len(value) != COUNT:
            raise MessageError(f"{name} of landmarks are a list of {COUNT}")
        return tuple(reader(each, name) for each in value)

    return read


def _point(value: Any, name: str) -> tuple[float, float, float]:
    x, y, z = numbers(value, name, 3, ROOM)
    return x, y, z


def _place(value: Any, name: str) -> Place:
    x, y, z, *turn = numbers(value, name, 7, ROOM)
    length = math.hypot(*turn)
    if abs(length - 1) > UNIT:
        raise MessageError(f"{name} ends in a quaternion of length 1")
    qx, qy, qz, qw = (each / length for each in turn)
    return Place((x, y, z), (qx, qy, qz, qw))


def _body(value: Any, name: str) -> BodyFit:
    """Take what an earlier calibration found."""
    read = number(-1.0, STATURE[1] + 1.0)
    found = {key: read(each, f"{name}.{key}") for key, each in _mapping(value, name).items()}
    try:
        return BodyFit.from_dict(found)
    except ConfigError as error:
        raise MessageError(str(error)) from error


def _mapping(value: Any, name: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise MessageError(f"{name} is an object")
    return value


@dataclass(frozen=True, kw_only=True)
class Range:
    """How far somebody gets, as they say.

    Attributes:
        lift_left_deg: How far the person can lift the left arm [deg].
        lift_right_deg: And the right one [deg].
        turn_deg: How far they can turn the head to a side [deg].
    """

    lift_left_deg: float = field_of(number(*LIFT_DEG), LIFT_DEG[1])
    lift_right_deg: float = field_of(number(*LIFT_DEG), LIFT_DEG[1])
    turn_deg: float = field_of(number(*TURN_DEG), TURN_DEG[1])


@dataclass(frozen=True)
class Begin(Range):
    """Begin a session, in the place of one that is on.

    Attributes:
        source: Where poses come from.
        height_m: Stature of the person [m].
        exercises: Names, in their order.
        repetitions: Right repetitions asked of each; as each exercise says if None.
        tempo: How fast the coach goes, against what the exercises say.
        mistake: What a simulated person does wrong.
        measure: Whether a calibration comes first; of hands, that is.
        body: What an earlier calibration of the same person found.
    """

    source: Source = field_of(one_of(SOURCES))
    height_m: float = field_of(number(*STATURE))
    exercises: tuple[str, ...] = field_of(_exercises)
    repetitions: int | None = field_of(or_null(whole(*REPETITIONS)), None)
    tempo: float = field_of(number(*TEMPO), 1.0)
    mistake: Mistake = field_of(one_of(MISTAKES), "none")
    measure: bool = field_of(flag, False)
    body: BodyFit | None = field_of(or_null(_body), None)


@dataclass(frozen=True)
class Hands:
    """What a headset reports; None for what is not tracked.

    Attributes:
        time: On the page's clock [s].
        head: Pose of the viewer.
        left: Joints of the left hand, or the grip of the left controller.
        right: Likewise.
    """

    time: float = field_of(number(0.0, LONGEST))
    head: Place | None = field_of(or_null(_place))
    left: HandJoints | Place | None = field_of(or_null(_hand))
    right: HandJoints | Place | None = field_of(or_null(_hand))


@dataclass(frozen=True)
class Landmarks:
    """Body landmarks of a pose detector, in its metres: x right in the picture, y down, z away.

    Attributes:
        time: On the page's clock [s].
        points: 33 points [m].
        visibility: How likely each is seen, 0 to 1.
    """

    time: float = field_of(number(0.0, LONGEST))
    points: tuple[tuple[float, float, float], ...] = field_of(_of_landmarks(_point))
    visibility: tuple[float, ...] = field_of(_of_landmarks(number(0.0, 1.0)))


@dataclass(frozen=True)
class Command:
    """What the person wants of the coach."""

    wish: Wish = field_of(one_of(WISHES))


@dataclass(frozen=True)
class Simulate:
    """What the simulated person does wrong from now on."""

    mistake: Mistake = field_of(one_of(MISTAKES))


@dataclass(frozen=True)
class Consent:
    """Whether the session may be recorded; taking it back deletes what was."""

    given: bool = field_of(flag)


def _file_name(value: Any, name: str) -> str:
    if not isinstance(value, str) or not FILE_NAME.fullmatch(value):
        raise MessageError(f"{name} is of a to z, 0 to 9 and _, at most 40 of them, a letter first")
    return value


@dataclass(frozen=True)
class Draft(Range):
    """An exercise that is being written; what it becomes, or what is wrong with it, is the answer.

    Attributes:
        name: Of its file.
        exercise: What its YAML would say; read as strictly as that.
    """

    name: str = field_of(_file_name)
    exercise: dict[str, Any] = field_of(_mapping)


Wanted = Begin | Hands | Landmarks | Command | Simulate | Consent  # of a session
Message = Wanted | Draft
KINDS: Mapping[str, type[Message]] = {
    each.__name__.lower(): each
    for each in (Begin, Hands, Landmarks, Command, Simulate, Consent, Draft)
}


def parse(text: str) -> Message:
    """Return the message that a text is; MessageError if it is none, which says why."""
    return parse_as(text, KINDS)
