"""What the page may say to the server: strictly read, one dataclass each.

A message is a JSON object of at most `LARGEST` bytes with exactly the fields of its type. Numbers are finite
and within bounds. Whatever is not so is refused; nothing of it is used.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields
from typing import Any, Literal, NoReturn, get_args

from rcare_marl.agents.coaching.sources.landmark_source import COUNT
from rcare_marl.errors import RcareError

LARGEST = 16 * 1024  # of a message [bytes]
ROOM = 50.0  # nothing that is tracked is further from the origin [m]
LONGEST = 1e8  # greatest time on a page's clock, three years [s]
UNIT = 0.01  # by how much the length of a quaternion may differ from 1
STATURE = (0.8, 2.3)  # of people at the page [m]
LIFT_DEG, TURN_DEG = (10.0, 180.0), (5.0, 90.0)
TEMPO = (0.5, 1.5)
REPETITIONS = (1, 20)

Source = Literal["hands", "simulated", "landmarks", "webcam"]
Mistake = Literal["none", "half_range", "one_side", "wrong_plane", "trunk_lean", "still"]
Wish = Literal["pause", "resume", "skip", "rest", "stop", "recentre"]
SOURCES: tuple[Source, ...] = get_args(Source)
MISTAKES: tuple[Mistake, ...] = get_args(Mistake)
WISHES: tuple[Wish, ...] = get_args(Wish)


class MessageError(RcareError, ValueError):
    """A message of the page is not what it may be."""


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
EXERCISE_NAME = re.compile(r"[^/\\\x00-\x1f]{1,80}")
Reader = Callable[[Any, str], Any]  # what is given, and its name for messages


def _read(reader: Reader, default: Any = MISSING) -> Any:
    """Return a field of a message, with what reads it."""
    return field(default=default, metadata={"read": reader})


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


def _flag(value: Any, name: str) -> bool:
    if not isinstance(value, bool):
        raise MessageError(f"{name} is true or false")
    return value


def _number(low: float, high: float) -> Reader:
    def read(value: Any, name: str) -> float:
        # A bool is an int to Python; a whole number may be too long for a float.
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not low <= value <= high
        ):
            raise MessageError(f"{name} is a number from {low:g} to {high:g}")
        return float(value)

    return read


def _whole(low: int, high: int) -> Reader:
    def read(value: Any, name: str) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise MessageError(f"{name} is a whole number from {low} to {high}")
        return value

    return read


def _one_of(known: Sequence[str]) -> Reader:
    def read(value: Any, name: str) -> str:
        if not isinstance(value, str) or value not in known:
            raise MessageError(f"{name} is one of {', '.join(known)}")
        return value

    return read


def _or_null(reader: Reader) -> Reader:
    return lambda value, name: None if value is None else reader(value, name)


def _of_landmarks(reader: Reader) -> Reader:
    def read(value: Any, name: str) -> tuple[Any, ...]:
        if not isinstance(value, list) or len(value) != COUNT:
            raise MessageError(f"{name} of landmarks are a list of {COUNT}")
        return tuple(reader(each, name) for each in value)

    return read


def _numbers(value: Any, name: str, count: int, bound: float) -> list[float]:
    if not isinstance(value, list) or len(value) != count:
        raise MessageError(f"{name} is a list of {count} numbers")
    return [_number(-bound, bound)(each, name) for each in value]


def _point(value: Any, name: str) -> tuple[float, float, float]:
    x, y, z = _numbers(value, name, 3, ROOM)
    return x, y, z


def _place(value: Any, name: str) -> Place:
    x, y, z, *turn = _numbers(value, name, 7, ROOM)
    length = math.hypot(*turn)
    if abs(length - 1) > UNIT:
        raise MessageError(f"{name} ends in a quaternion of length 1")
    qx, qy, qz, qw = (each / length for each in turn)
    return Place((x, y, z), (qx, qy, qz, qw))


@dataclass(frozen=True)
class Begin:
    """Begin a session, in the place of one that is on.

    Attributes:
        source: Where poses come from.
        height_m: Stature of the person [m].
        exercises: Names, in their order.
        repetitions: Right repetitions asked of each; as each exercise says if None.
        tempo: How fast the coach goes, against what the exercises say.
        lift_left_deg: How far the person can lift the left arm [deg].
        lift_right_deg: And the right one [deg].
        turn_deg: How far they can turn the head to a side [deg].
        mistake: What a simulated person does wrong.
    """

    source: Source = _read(_one_of(SOURCES))
    height_m: float = _read(_number(*STATURE))
    exercises: tuple[str, ...] = _read(_exercises)
    repetitions: int | None = _read(_or_null(_whole(*REPETITIONS)), None)
    tempo: float = _read(_number(*TEMPO), 1.0)
    lift_left_deg: float = _read(_number(*LIFT_DEG), LIFT_DEG[1])
    lift_right_deg: float = _read(_number(*LIFT_DEG), LIFT_DEG[1])
    turn_deg: float = _read(_number(*TURN_DEG), TURN_DEG[1])
    mistake: Mistake = _read(_one_of(MISTAKES), "none")


@dataclass(frozen=True)
class Hands:
    """What a headset reports; None for what is not tracked.

    Attributes:
        time: On the page's clock [s].
        head: Pose of the viewer.
        left: Joints of the left hand, or the grip of the left controller.
        right: Likewise.
    """

    time: float = _read(_number(0.0, LONGEST))
    head: Place | None = _read(_or_null(_place))
    left: HandJoints | Place | None = _read(_or_null(_hand))
    right: HandJoints | Place | None = _read(_or_null(_hand))


@dataclass(frozen=True)
class Landmarks:
    """Body landmarks of a pose detector, in its metres: x right in the picture, y down, z away.

    Attributes:
        time: On the page's clock [s].
        points: 33 points [m].
        visibility: How likely each is seen, 0 to 1.
    """

    time: float = _read(_number(0.0, LONGEST))
    points: tuple[tuple[float, float, float], ...] = _read(_of_landmarks(_point))
    visibility: tuple[float, ...] = _read(_of_landmarks(_number(0.0, 1.0)))


@dataclass(frozen=True)
class Command:
    """What the person wants of the coach."""

    wish: Wish = _read(_one_of(WISHES))


@dataclass(frozen=True)
class Simulate:
    """What the simulated person does wrong from now on."""

    mistake: Mistake = _read(_one_of(MISTAKES))


@dataclass(frozen=True)
class Consent:
    """Whether the session may be recorded; taking it back deletes what was."""

    given: bool = _read(_flag)


Message = Begin | Hands | Landmarks | Command | Simulate | Consent
KINDS: Mapping[str, type[Message]] = {
    each.__name__.lower(): each for each in (Begin, Hands, Landmarks, Command, Simulate, Consent)
}


def parse(text: str) -> Message:
    """Return the message that a text is.

    Raises:
        MessageError: If it is none; it says why.
    """
    if len(text) > LARGEST or len(text.encode("utf-8", "surrogatepass")) > LARGEST:
        raise MessageError(f"a message has at most {LARGEST} bytes")
    try:
        data = json.loads(text, object_pairs_hook=_once, parse_constant=_constant)
    except MessageError:
        raise
    except (ValueError, RecursionError) as error:
        # A long number and deep nesting end up here, too.
        raise MessageError("a message is a JSON object") from error
    if not isinstance(data, dict):
        raise MessageError("a message is a JSON object")
    kind = data.pop("type", None)
    if not isinstance(kind, str) or kind not in KINDS:
        raise MessageError(f"the type of a message is one of {', '.join(KINDS)}")
    made = KINDS[kind]
    known = {each.name: each for each in fields(made)}
    needed = {name for name, each in known.items() if each.default is MISSING}
    missing, unknown = needed - data.keys(), data.keys() - known.keys()
    if missing:
        raise MessageError(f"missing: {', '.join(sorted(missing))}")
    if unknown:  # their names come from outside and are not repeated
        raise MessageError(f"unknown fields; known: {', '.join(sorted(known))}")
    return made(**{name: known[name].metadata["read"](value, name) for name, value in data.items()})


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    out = dict(pairs)
    if len(out) != len(pairs):
        raise MessageError("a field is given twice")
    return out


def _constant(name: str) -> NoReturn:
    raise MessageError(f"{name} is no number that may be sent")
