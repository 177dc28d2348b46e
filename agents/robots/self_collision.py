"""Which links of a robot may touch each other, and which do."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rcare_marl.body import Body
from rcare_marl.model.urdf import Model

TOUCH = 1e-4  # [m] deep; shallower contact is no overlap


def overlapping(body: Body, apart_from: set[tuple[str, str]]) -> list[tuple[str, str]]:
    """Return the pairs of links of `body` that overlap, but those in `apart_from`."""
    out = []
    names = body.link_names
    solid = body.solid_links()
    for k, a in enumerate(solid):
        for b in solid[k + 1 :]:
            pair = (names[a], names[b])
            if pair in apart_from or pair[::-1] in apart_from:
                continue
            if body.own_gap(a, b) < -TOUCH:
                out.append(pair)
    return out


def touching_links(
    model: Model, body: Body, hands: Iterable[Sequence[str]] = ()
) -> set[tuple[str, str]]:
    """Return the pairs of links that touch by design.

    Those are links that share a joint, with all that is fixed to them, links between which there are
    only links without collision shape, and all links of one hand, whose linkages are not closed.

    Args:
        model: The robot.
        body: It, spawned.
        hands: The finger links of each hand.
    """
    rigid: dict[str, str] = {model.root: model.root}  # what each link is one with
    near: dict[str, set[str]] = {model.root: set()}
    for joint in model.joints.values():  # parents come before children
        carrier = rigid[joint.parent]
        if joint.kind == "fixed":
            rigid[joint.child] = carrier
            continue
        rigid[joint.child] = joint.child
        near[joint.child] = {carrier}
        near[carrier].add(joint.child)
    solid = [body.link_names[i] for i in body.solid_links()]
    # The base of a body also goes by that name.
    parts = {
        link: rigid[model.root if link == "base" and link not in rigid else link] for link in solid
    }
    touching: dict[str, set[str]] = {}
    for part in set(parts.values()):
        seen, front = {part}, [part]
        while front:
            for other in near[front.pop()] - seen:
                seen.add(other)
                if other not in parts.values():
                    front.append(other)
        touching[part] = seen
    out = {(a, b) for a in solid for b in solid if a != b and parts[b] in touching[parts[a]]}
    for fingers in hands:
        hand = _carried(model, fingers) & body.links.keys()
        out |= {(a, b) for a in hand for b in hand if a != b}
    return out


def _carried(model: Model, fingers: Sequence[str]) -> set[str]:
    """Return the links of a hand: all beyond the first link that carries both fingers."""
    ways = [[f, *(model.joints[joint].parent for joint in model.way(f))] for f in fingers]
    palm = next(link for link in ways[0] if link in ways[1])
    hand = {palm}
    for joint in model.joints.values():  # parents come before children
        if joint.parent in hand:
            hand.add(joint.child)
    return hand
