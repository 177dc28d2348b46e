"""A coach as one person of the group sees and hears it."""

from __future__ import annotations

from rcare_marl.agents.coaching.group_session import GroupSession
from rcare_marl.agents.coaching.session import Demonstration, Word
from rcare_marl.pose import Array


class GroupView:
    """What the coach of a group shows and says to one person, for a `Learner`.

    What is shown is as far as this person goes; who has nothing to do sees them at rest. Words to somebody
    else are not heard.

    Attributes:
        session: The session of this person.
        demonstration: The view itself.
    """

    def __init__(self, group: GroupSession, name: str, shown: Demonstration) -> None:
        """Take the lesson, who looks at it, and what is shown to all."""
        self.session = group.members[name]
        self._group, self._name, self._shown = group, name, shown
        self.demonstration = self

    @property
    def angles(self) -> Array:
        """What is shown now, as far as this person goes [rad], shape [16]."""
        is_busy = self._group.is_busy(self._name)
        return self.session.exercise.angles(self._shown.shown_for if is_busy else 0.0)

    @property
    def count(self) -> int:
        """Repetitions that have been shown to their end, of the present exercise of this person."""
        return self._shown.count if self._group.takes_part(self._name) else 0

    @property
    def word(self) -> Word:
        """What is being said, or was said last."""
        return self._shown.word

    @property
    def is_speaking(self) -> bool:
        """Whether something is being said that this person is to hear."""
        return self._shown.is_speaking and self._shown.spoken_to in (None, self._name)
