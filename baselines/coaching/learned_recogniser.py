"""Recognition by a network that was shown synthetic people who do it right and wrong.

It sees what the rules see, found by the same segmenter, and decides what a repetition was; the green
window, how far and how even it was, and what is no movement at all stay with the rules.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import torch

from rcare_marl.agents.coaching.exercise import Exercise
from rcare_marl.agents.coaching.recognition.assessment import Motion
from rcare_marl.agents.coaching.recognition.recogniser import Repetition
from rcare_marl.agents.coaching.recognition.rule_recogniser import RuleRecogniser
from rcare_marl.agents.coaching.recognition.segmenter import Segment
from rcare_marl.agents.coaching.recognition.template import Template

from .encoding import asked_rows, encode
from .network import CLASSES, RepetitionNetwork, load_network

SHIPPED = Path(__file__).with_name("recogniser.npz")
UNSEEN = "not_seen"


@cache
def _network(file: Path) -> RepetitionNetwork:
    return load_network(file)[0]


class LearnedRecogniser(RuleRecogniser):
    """Judges repetitions by a network.

    The measures of a repetition are those of the rules, and `right`: how sure the network is of that, 0 to 1.
    """

    def __init__(self, *, known: Sequence[Exercise] | None = None, file: Path = SHIPPED) -> None:
        """Prepare recognition.

        Args:
            known: Exercises that the rules may take a movement for; all there are if None.
            file: The network, of `train_recogniser`.

        Raises:
            ConfigError: If the file holds no such network.
        """
        super().__init__(known=known)
        self._network = _network(file)

    def begin(self, exercise: Exercise) -> None:
        """Expect an exercise from now on."""
        super().begin(exercise)
        self._asked = asked_rows(Template(exercise))

    def _judged(self, template: Template, segment: Segment) -> Repetition | None:
        by_rules = super()._judged(template, segment)
        if by_rules is None or by_rules.errors[:1] == (UNSEEN,):
            return by_rules
        sequence, facts = encode(Motion.of(segment), segment, template, self._asked)
        with torch.inference_mode():
            logits = self._network(torch.from_numpy(sequence)[None], torch.from_numpy(facts)[None])
        chances = torch.softmax(logits[0], dim=0).tolist()
        right = chances[0]
        measures = {**by_rules.measures, "right": right}
        if right >= 0.5:
            return replace(by_rules, right=True, errors=(), measures=measures)
        worst = max(range(1, len(CLASSES)), key=lambda k: chances[k])
        return replace(by_rules, right=False, errors=(CLASSES[worst],), measures=measures)
