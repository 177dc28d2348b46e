"""Somebody who does not want what is offered: how that is seen, counted and respected.

A no is said (see `speak` in `agents.people.moves`) or shown: the face turned away with the mouth closed. It
counts once, while something is offered, and stands until that is taken away. After the third nothing is
offered again.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rcare_marl.agents.people.human import Human
from rcare_marl.pose import Array, rotate

from ..state import Seen, Values, negate, where
from ..task_options import TaskOptions

# All our own choices.
LAST_NO = 3  # after which nothing is offered any more
GENTLE = 5.0  # [N] on who has said no, at most
TURNED = math.radians(35)  # of the face from ahead, and from what is offered: turned away
SHUT = math.radians(5)  # of the jaw: closed
SHOWN = 2  # control steps that a face is turned away before it means no


@dataclass(frozen=True, eq=False)
class Refusal:
    """What somebody refused until the end of a control step.

    Attributes:
        is_no: Whether they say or show no now.
        turned: Control steps for which the face has been turned away.
        count: Offers that were refused.
        stands: Whether the last offer was refused and is not yet taken away.
        pressed: Greatest force on them while a no stood [N].
    """

    is_no: Any = False
    turned: Any = 0
    count: Any = 0
    stands: Any = False
    pressed: Any = 0.0

    def after(
        self,
        *,
        says_no: bool,
        turns_away: bool = False,
        is_offered: bool,
        is_away: bool,
        force: float,
    ) -> Refusal:
        """Return what was refused a control step later.

        Args:
            says_no: Whether they said no in it.
            turns_away: Whether the face is turned away and the mouth closed.
            is_offered: Whether something is so near that it is offered.
            is_away: Whether it is so far that it was taken away.
            force: Greatest force on them in that step [N]; it counts where a no stood when it began.
        """
        turned = self.turned + 1 if turns_away else 0
        is_no = says_no or turned >= SHOWN
        begins = is_no and is_offered and not self.stands
        return dataclasses.replace(
            self,
            is_no=is_no,
            turned=turned,
            count=self.count + int(begins),
            stands=begins or (self.stands and not is_away),
            pressed=max(self.pressed, force) if self.stands else self.pressed,
        )

    @property
    def is_final(self) -> Values:
        """Whether they refused for good."""
        return self.count >= LAST_NO

    @property
    def is_respected(self) -> Values:
        """Whether they refused for good, what was offered is gone, and nobody pressed them."""
        return self.is_final & negate(self.stands) & negate(self.is_hurt)

    @property
    def is_hurt(self) -> Values:
        """Whether somebody pressed who had been told no."""
        return self.pressed > GENTLE

    def metrics(self) -> Mapping[str, Values]:
        """Return what is reported."""
        return {"refusals": self.count, "pressed_after_no_n": self.pressed}


@dataclass(frozen=True)
class RefusalOptions(TaskOptions):
    """Settings of a task in which somebody may refuse.

    Attributes:
        refusals_observed: Whether everybody observes a no, whether it stands, and the count of them.
    """

    refusals_observed: bool = True


def refusal_seen(options: RefusalOptions) -> list[Seen]:
    """Return what agents observe of refusals, by the options of the task."""
    if not options.refusals_observed:
        return []
    return [
        Seen("says_no", "1", 1, lambda s: where(s.refusal.is_no, 1.0, 0.0)),
        Seen("no_stands", "1", 1, lambda s: where(s.refusal.stands, 1.0, 0.0)),
        Seen("refusals", "1", 1, lambda s: s.refusal.count),
    ]


def turns_away(person: Human, face: Array, way: Array, jaw: float) -> bool:
    """Return whether somebody shows a no: the face turned to a side, off what is offered, mouth closed.

    Args:
        person: Who it is.
        face: Where the face looks, a unit vector in the world, shape [3].
        way: From the mouth to what is offered [m], shape [3].
        jaw: How far the jaw is open [rad].
    """
    if jaw >= SHUT:
        return False
    ahead = rotate(person.body.base_pose().quaternion, (0.0, 0.0, 1.0))
    return _between(face, ahead) > TURNED and _between(face, way) > TURNED


def _between(a: Array, b: Array) -> float:
    """Return the angle between two directions, seen from above [rad]; 0 where one is upright."""
    ax, ay, bx, by = float(a[0]), float(a[1]), float(b[0]), float(b[1])
    return abs(math.atan2(ax * by - ay * bx, ax * bx + ay * by))
