"""Surfaces that paths go round, in torch: the mathematics of `muscle_wrap.py` for many people at once."""

from __future__ import annotations

import torch
from torch import Tensor

from .muscle_wrap import BLEND, CLEAR, NEAR, TINY


def wrapped(
    before: Tensor, after: Tensor, radius: Tensor, axial: Tensor
) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
    """Return both spots on w surfaces, how much longer than their distance the way is, and pushes.

    Args:
        before: The point before each surface, in its frame [m], shape [w, 3, n].
        after: The point after it [m], shape [w, 3, n].
        radius: Radius [m], shape [w, 1].
        axial: 1 for a cylinder and 0 for a sphere, shape [w, 1, 1].

    Returns:
        The spots [m], of shape [w, 3, n] each, the difference [m], shape [w, n], and by how much the
        surface, where it makes room for them, pushes either point, shape [w, 3, n] each.
    """
    flat = torch.ones_like(before)
    flat[:, 2:] = flat[:, 2:] - axial  # what of a vector lies across the axis of a cylinder
    p, s = before * flat, after * flat
    size = p.norm(dim=1, keepdim=True)
    e = p / size
    along = (e * s).sum(1, keepdim=True)
    across = s - along * e
    # A cylinder is gone round counter-clockwise, a sphere the short way.
    beside = across.square().sum(1, keepdim=True).clamp(min=TINY * TINY).sqrt()
    left = torch.stack((-e[:, 1], e[:, 0], torch.zeros_like(e[:, 0])), 1)
    f = torch.where(axial > 0.5, left, across / beside)
    beside = (f * s).sum(1, keepdim=True)
    a, b, c, d, angle, arc, out, back, by_p, by_s = _round(
        size[:, 0], along[:, 0], beside[:, 0], radius
    )
    touches = (arc >= 0.0)[:, None]
    axis = torch.zeros_like(before)
    axis[:, 2] = axial[:, 0].expand_as(axis[:, 2])
    rise = (after - before)[:, 2] * axial[:, 0] / (out + arc.clamp(min=0.0) + back)
    height = before[:, 2] + rise * out
    first = e * a[:, None] + f * b[:, None] + axis * height[:, None]
    second = e * c[:, None] + f * d[:, None] + axis * (height + rise * arc)[:, None]
    chord = (c - a) ** 2 + (d - b) ** 2
    climb = (1.0 + rise * rise).sqrt() * arc
    apart = touches[:, 0] & (arc > 0.0)
    between = torch.where(apart, chord + (rise * arc) ** 2, torch.ones_like(chord)).sqrt()
    extra = torch.where(apart, climb - between, torch.zeros_like(chord))
    middle = 0.5 * (before + after)
    push = (angle / (1.0 + rise * rise).sqrt())[:, None] * touches
    first, second = torch.where(touches, first, middle), torch.where(touches, second, middle)
    return first, second, extra, push * by_p[:, None] * p, push * by_s[:, None] * s


def _room(distance: Tensor) -> tuple[Tensor, Tensor]:
    short = (NEAR - distance).clamp(min=0.0)
    bend = 0.5 * CLEAR / BLEND
    is_far = short < BLEND
    share = torch.where(is_far, 1.0 - bend * short * short, CLEAR * distance)
    return share, torch.where(is_far, 2.0 * bend * short, torch.full_like(short, CLEAR))


def _round(p: Tensor, s0: Tensor, s1: Tensor, radius: Tensor) -> tuple[Tensor, ...]:
    s = (s0 * s0 + s1 * s1).sqrt()
    (share, slope), (other, other_slope) = _room(p / radius), _room(s / radius)
    r = radius * share * other
    out, back = (p * p - r * r).sqrt(), (s * s - r * r).sqrt()
    a0, a1 = r * r / p, r * out / p
    b0, b1 = r * (r * s0 + back * s1) / (s * s), r * (r * s1 - back * s0) / (s * s)
    sine = a0 * b1 - a1 * b0
    touches = torch.where(s1 < 0.0, s0 < -s1, sine > 0.0)
    angle = torch.atan2(sine, a0 * b0 + a1 * b1)
    angle = torch.where(angle < 0.0, angle + 2.0 * torch.pi, angle)
    arc = torch.where(touches, r * angle, -torch.ones_like(p))
    return a0, a1, b0, b1, angle, arc, out, back, slope * other / p, other_slope * share / s
