"""A lesson for several people at once: each has their own programme, and is counted by themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rcare_marl.errors import ConfigError

from .exercise import Exercise, Reach
from .recognition.recogniser import Frame, Judgement
from .session import Lesson, Session, Word, top_speed


def group_programme(
    exercises: Sequence[Exercise], reaches: Mapping[str, Reach], *, speed: float
) -> tuple[tuple[Exercise, ...], dict[str, tuple[Exercise, ...]]]:
    """Return what is shown to a group, and what it is for each person, at one tempo for all.

    An exercise is shown whole, and left out if nobody can do any of it. A person does what is within
    their reach; exercises of which nothing is left are not in their programme.

    Args:
        exercises: What everybody is asked.
        reaches: What each person can do, by name.
        speed: How fast an arm or the head goes at most [rad/s].

    Raises:
        ConfigError: If somebody can do none of them.
    """
    shown = []
    own: dict[str, list[Exercise]] = {name: [] for name in reaches}
    for exercise in exercises:
        paced = exercise.faster(min(1.0, speed / top_speed(exercise)))
        found = {name: paced.adapted(reach) for name, reach in reaches.items()}
        able = [name for name, theirs in found.items() if theirs.can_do]
        if able:
            shown.append(paced)
        for name in able:
            own[name].append(found[name])
    for name, theirs in own.items():
        if not theirs:
            names = ", ".join(exercise.name for exercise in exercises)
            raise ConfigError(f"{name} can do none of the exercises {names}: choose others")
    return tuple(shown), {name: tuple(theirs) for name, theirs in own.items()}


class GroupSession(Lesson):
    """The lesson of a group: the tree and the body of a coach lead it as that of one person.

    Who cannot do the exercise that is on, or has done it often enough, is not watched and rests. It is done
    when everybody has done it. The green window is open when all who still have to do something follow, and
    the group is as tired as the tiredest of them.

    Attributes:
        members: The session of each person, by name; its exercises are some of those that are shown.
        neediest: Who needs a word most: of those who still have something to do the one who has waited
            longest for a right repetition or for a word; None where nobody has.
        praised: Of those who have just done a repetition rightly the one with the most left to do; None
            where nobody has.
    """

    def __init__(self, exercises: Sequence[Exercise], members: Mapping[str, Session]) -> None:
        """Gather a group.

        Args:
            exercises: What is shown, see `group_programme`.
            members: The session of each person, by name, their exercises in the same order.

        Raises:
            ConfigError: If there is nobody or nothing to show, or somebody has another exercise.
        """
        super().__init__(exercises)
        if not members:
            raise ConfigError("a group needs at least one person")
        order = [exercise.name for exercise in exercises]
        for name, session in members.items():
            theirs = [exercise.name for exercise in session.exercises]
            if theirs != [known for known in order if known in theirs]:
                raise ConfigError(
                    f"exercises of {name} must be some of {', '.join(order)}, in this order, got "
                    f"{', '.join(theirs)}"
                )
        self.members = dict(members)
        self.reset()

    def reset(self) -> None:
        """Begin anew; whoever calls it has reset the sessions of the members."""
        self.neediest: str | None = None
        self.praised: str | None = None
        self._spoken_at = dict.fromkeys(self.members, 0.0)
        self._restart()

    def takes_part(self, name: str) -> bool:
        """Return whether the exercise that is on is in a person's programme."""
        session = self.members[name]
        return not (self.is_over or session.is_over) and session.exercise.name == self.exercise.name

    def is_busy(self, name: str) -> bool:
        """Return whether a person still has to do the exercise that is on."""
        return self.takes_part(name) and not self.members[name].is_done

    @property
    def is_complete(self) -> bool:
        return all(session.is_complete for session in self.members.values())

    @property
    def is_done(self) -> bool:
        return not (self.is_over or any(map(self.is_busy, self.members)))

    @property
    def is_spent(self) -> bool:
        return any(self.is_busy(name) and self.members[name].is_spent for name in self.members)

    def begin_exercise(self) -> None:
        super().begin_exercise()
        for name, session in self.members.items():
            session.time = self.time
            if self.takes_part(name):
                session.begin_exercise()
        self._look_round(())

    def go_on(self) -> None:
        """Go on to the next exercise; those who have not done the present one have skipped it."""
        for name, session in self.members.items():
            if self.takes_part(name):
                session.go_on()
        super().go_on()

    def keep_tempo(self, tempo: float) -> None:
        for name, session in self.members.items():
            if self.takes_part(name):
                session.keep_tempo(tempo)

    def see(self, frames: Mapping[str, Frame | None], time: float) -> None:
        """Take what was seen of each person, by name, at a time [s]; None of who was not seen."""
        self.time = time
        watched = [name for name in self.members if self.is_busy(name)]
        self.fatigue = max((self.members[name].fatigue for name in watched), default=0.0)
        for name, session in self.members.items():
            session.judgement = Judgement() if name not in watched else session.judgement
            session.is_resting = self.is_resting
            session.see(frames[name] if name in watched else None, time)
        self._look_round(watched)

    def _look_round(self, watched: Sequence[str]) -> None:
        """Find who needs a word, of whom one has just seen `watched`."""
        busy = [name for name in self.members if self.is_busy(name)]
        found = {name: self.members[name].judgement.finished for name in watched}
        praised = [name for name, done in found.items() if done is not None and done.right]
        self.praised = max(praised, key=self._left, default=None)
        self.neediest = min(busy, key=self._waits_since, default=None)
        sessions = [self.members[name] for name in busy]
        self.right_at = min((session.right_at for session in sessions), default=self.time)
        self.hint = self.members[self.neediest].hint if self.neediest else ""
        self.away_for = self.members[self.neediest].away_for if self.neediest else 0.0
        self.judgement = Judgement(
            following=bool(busy) and all(session.judgement.following for session in sessions),
            progress=min((session.judgement.progress for session in sessions), default=0.0),
            finished=self.members[self.praised].judgement.finished if self.praised else None,
            hint=self.hint,
        )

    def _left(self, name: str) -> int:
        session = self.members[name]
        return sum(session.wanted) - session.right_count

    def _waits_since(self, name: str) -> float:
        return max(self.members[name].right_at, self._spoken_at[name])

    def address(self, word: Word) -> tuple[str | None, str]:
        """Return to whom a word is said, and the sentence: an explanation is for everybody."""
        name = self.praised if word == "praise" else self.neediest
        if word == "explain":
            return None, self.exercise.say
        if word == "nothing" or name is None:
            return None, next(iter(self.members.values())).sentence(word)
        self._spoken_at[name] = self.time
        return name, f"{name}: {self.members[name].sentence(word)}"
