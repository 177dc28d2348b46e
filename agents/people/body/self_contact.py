"""Which parts of a person can meet each other: limbs with trunk, head and other limbs.

Neighbours at a joint, and an upper arm and the chest beside it, always overlap: their shapes are fitted to
one skin. Fingers meet what their palm meets only where they do not move.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations

from .skeleton import JOINTS, PARENTS, SIDES

_TRUNK = ("pelvis", "spine1", "spine2", "spine3")
_ARM, _LEG = ("elbow", "wrist"), ("hip", "knee", "ankle")


def meeting_segments() -> frozenset[tuple[str, str]]:
    """Return the pairs of segments that can meet, in the order of the skeleton."""
    pairs: set[frozenset[str]] = set()
    legs = [f"{side}_{part}" for side in SIDES for part in _LEG]
    for side, other in (SIDES, SIDES[::-1]):
        upper = f"{side}_shoulder"
        for part in (f"{side}_{name}" for name in _ARM):
            met = (*_TRUNK, "neck", "head", *legs, f"{other}_shoulder")
            pairs |= {frozenset((part, thing)) for thing in met}
            pairs |= {frozenset((part, f"{other}_{name}")) for name in _ARM}
        pairs |= {frozenset((upper, thing)) for thing in ("spine1", "pelvis")}
        pairs |= {
            frozenset((f"{side}_{own}", f"{other}_{theirs}")) for own in _LEG for theirs in _LEG
        }
    order = JOINTS.index
    return frozenset(tuple(sorted(pair, key=order)) for pair in pairs)  # type: ignore[misc]


def meeting_links(
    parts: Mapping[int, Sequence[str]], *, legs: bool = True
) -> list[tuple[int, int]]:
    """Return the pairs of links that can meet.

    Args:
        parts: The segments that each link carries; several where joints between them do not move.
        legs: Whether legs meet anything.
    """
    wanted = {p for p in meeting_segments() if legs or not any(s.endswith(_LEG) for s in p)}
    found = []
    for a, b in combinations(sorted(parts), 2):
        pairs = [tuple(sorted((s, t), key=JOINTS.index)) for s in parts[a] for t in parts[b]]
        if any(pair in wanted for pair in pairs) and not any(map(_overlaps, pairs)):
            found.append((a, b))
    return found


def _overlaps(pair: Iterable[str]) -> bool:
    """Return whether two segments, in the order of the skeleton, are neighbours or nearly so."""
    first, second = pair
    if JOINTS[PARENTS[JOINTS.index(second)]] == first:
        return True
    return second.endswith("_shoulder") and first in ("spine2", "spine3", "neck")
