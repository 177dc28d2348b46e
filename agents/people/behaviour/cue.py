"""What reaches a person from outside their tree: instructions, urges, and where to reach."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

from rcare_marl.errors import ConfigError, check_name

from ...agent import Array

Part = Literal["body", "head", "mouth", "limbs"]
Answer = Literal["nothing asked", "cannot", "trying", "done"]


@dataclass(frozen=True)
class Gesture:
    """What a sentence asks for.

    Attributes:
        part: Which branch of the tree follows it.
        angles: Wished angle by DoF [rad]; those not named stay free. None where a leaf of its own
            does it.
    """

    part: Part
    angles: Mapping[str, float] | None = None


def _gesture(part: Part, **degrees: float) -> Gesture:
    return Gesture(part, {dof: math.radians(angle) for dof, angle in degrees.items()})


# Sentences that people understand. Angles are DoFs (docs/avatars.md) in degrees; our own choices.
GESTURES: dict[str, Gesture] = {
    "hold still": Gesture("body"),
    "relax": Gesture("body"),
    "open your mouth": Gesture("mouth"),
    "close your mouth": _gesture("mouth", jaw_opening=0),
    "look at me": Gesture("head"),
    "look ahead": _gesture(
        "head", neck_rotation_left=0, head_rotation_left=0, neck_flexion=3, head_flexion=3
    ),
    "turn your head left": _gesture("head", neck_rotation_left=22, head_rotation_left=22),
    "turn your head right": _gesture("head", neck_rotation_left=-22, head_rotation_left=-22),
    "lift your chin": _gesture("head", neck_flexion=-10, head_flexion=-12),
    "lower your arms": Gesture("limbs"),
    "lean forward": _gesture("limbs", spine1_flexion=14, spine2_flexion=10),
    "sit back": Gesture("limbs"),
    **{
        f"{verb} your {side} {limb}": Gesture(
            "limbs", {f"{side}_{dof}": math.radians(angle) for dof, angle in degrees.items()}
        )
        for side in ("left", "right")
        for verb, limb, degrees in (
            ("raise", "arm", {"shoulder_flexion": 75, "elbow_flexion": 30}),
            ("bend", "elbow", {"elbow_flexion": 115}),
            ("straighten", "elbow", {"elbow_flexion": 15}),
            ("lift", "leg", {"hip_flexion": 105, "knee_flexion": 30}),
        )
    },
}


class Instruction:
    """What a caregiver, another agent or the user has last asked of a person.

    Attributes:
        possible: Sentences that this person can do something about.
        speaker: Returns where the speaker's face is [m], shape [3], for `look at me`; None if unknown.
        text: The sentence in force, if any; `say` and `clear` set it.
        answer: How the person gets on with it, for whoever asked.
        count: How often something has been said.
    """

    def __init__(self, possible: Iterable[str] = ()) -> None:
        """Take the sentences that the person can do something about."""
        self.possible = frozenset(possible)
        self.speaker: Callable[[], Array] | None = None
        self.text: str | None = None
        self.answer: Answer = "nothing asked"
        self.count = 0

    def say(self, text: str, *, speaker: Callable[[], Array] | None = None) -> None:
        """Ask for something; it stays in force until something else is said or `clear`.

        Raises:
            UnknownNameError: If the sentence is none of `GESTURES`.
        """
        check_name("instruction", text, GESTURES)
        self.text, self.answer = text, "trying"
        self.count += 1
        if speaker is not None:
            self.speaker = speaker
        if text not in self.possible or (text == "look at me" and self.speaker is None):
            self.answer = "cannot"

    def is_asked(self, text: str) -> bool:
        """Return whether a sentence is in force that the person can do something about."""
        return self.text == text and self.answer != "cannot"

    def clear(self) -> None:
        """Ask for nothing any more."""
        self.text, self.answer = None, "nothing asked"


CUES = ("instruction", "must_cough", "refuses", "reach")


class Cues:
    """Everything that reaches a person from outside their tree; settable at any time.

    Attributes:
        instruction: What was last asked of them.
        must_cough: Whether they have to cough; the cough clears it.
        refuses: Whether they do not want what is offered.
        reach: What returns the wished angles of a reach by DoF [rad], from inverse kinematics or by hand.

    Any other name is an UnknownNameError.
    """

    def __init__(self, instruction: Instruction | None = None) -> None:
        """Begin without any cue."""
        self.instruction = instruction or Instruction()
        self.must_cough = self.refuses = False
        self.reach: Callable[[], Mapping[str, float]] | None = None

    def __setattr__(self, name: str, value: object) -> None:
        check_name("cue", name, CUES)
        if name == "reach" and value is not None and not callable(value):
            raise ConfigError(f"reach takes a function that returns angles, got {value!r}")
        object.__setattr__(self, name, value)

    def clear(self) -> None:
        """Forget every cue, as at the start of an episode."""
        self.instruction.clear()
        self.instruction.speaker = None
        self.must_cough = self.refuses = False
        self.reach = None
