"""Who may judge repetitions, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from rcare_marl.agents.coaching.recognition.recogniser import Recogniser
from rcare_marl.agents.coaching.recognition.rule_recogniser import RuleRecogniser
from rcare_marl.errors import check_name


def _learned() -> Recogniser:
    from .learned_recogniser import LearnedRecogniser  # brings torch

    return LearnedRecogniser()


RECOGNISERS: Mapping[str, Callable[[], Recogniser]] = {
    "rules": RuleRecogniser,
    "learned": _learned,
}
DEFAULT = "rules"


def recogniser_maker(name: str) -> Callable[[], Recogniser]:
    """Return what makes a recogniser.

    Raises:
        UnknownNameError: If there is none of that name.
    """
    check_name("recogniser", name, RECOGNISERS)
    return RECOGNISERS[name]
