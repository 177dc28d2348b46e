"""The muscles of a person in torch: the same mathematics as `muscle_kernel.py`, for many people at once.

Every operation can be differentiated, so that excitations, postures and the figures of the muscles
themselves can be learned, and runs where its tensors live. People are the last axis inside, so that each
operation is one pass over contiguous memory; callers see them first.

Moment arms use that both a joint and a taut path are lines in space: the screw of the joint (axis, and origin
x axis) times the wrench of the path (moment and force of a unit tension) is the rate of length.

On a GPU sums are collected in no fixed order, so the last digit can differ from run to run;
`torch.use_deterministic_algorithms(True)` fixes it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch
from torch import Tensor

from rcare_marl.errors import ActionError
from rcare_marl.pose import Array
from rcare_marl.tree.dynamics import AXIS, OFFSET, ROTATION
from rcare_marl.tree.joint_tree import Ints

from . import hill
from . import muscle_kernel as kernel
from .muscle_layout import ARM, ARM_BEFORE, BLADE_ROWS, RADIUS
from .muscle_model import MuscleModel
from .muscle_torch_scapula import TorchScapulae
from .muscle_torch_wrap import wrapped
from .muscle_wrap import CENTRE, IS_CYLINDER, TURN, WRAP_RADIUS

NEWTON_STEPS = 60  # at most, for the fibre length of the implicit tendon; it needs 4 to 8
NEWTON_ERROR = 1e-12  # [optimal fibre lengths] at which they end


class TorchState(NamedTuple):
    """Muscles of n people after a step, each entry of shape [n, m].

    Attributes:
        activation: Activation, in [0, 1].
        tendon: Last tension [F_max]; with the implicit tendon the fibre length [optimal lengths].
        active: Tension by activation [N].
        passive: Tension by stretch and damping [N].
    """

    activation: Tensor
    tendon: Tensor
    active: Tensor
    passive: Tensor


class TorchMuscles(torch.nn.Module):
    """Muscles over the moving parts of a body, in torch; float64 agrees with `MuscleModel` to 1e-9.

    The figures of the muscles are parameters that do not ask for gradients until told so, as by
    `muscles.force.requires_grad_()`.

    Attributes:
        names: The muscles, m of them.
        dofs: The moving DoFs, d of them.
        tendon: How the tendon yields, as in `MuscleModel`.
        force: Greatest isometric force [N], shape [m].
        fibre: Optimal fibre length [m], shape [m].
        slack: Tendon slack length [m], shape [m].
        pennation_sine: Sine of the pennation at optimal length, shape [m].
        strain: Strain of the fibre at which passive force is `force`, shape [m].
        strength: Share of full excitation that reaches each muscle, shape [m].
    """

    if TYPE_CHECKING:  # figures and constants are registered by name

        def __getattr__(self, name: str) -> Tensor: ...

    def __init__(
        self,
        model: MuscleModel,
        *,
        device: torch.device | str = "cpu",
        dtype: torch.dtype = torch.float64,
    ) -> None:
        """Copy the muscles of a model.

        Args:
            model: The muscles.
            device: Where the tensors live; `.to` moves them later.
            dtype: Their type.
        """
        super().__init__()
        self.names, self.dofs, self.tendon = model.names, model.dofs, model.tendon
        columns = {
            "force": kernel.FORCE,
            "fibre": kernel.FIBRE,
            "slack": kernel.SLACK,
            "pennation_sine": kernel.PENNATION_SINE,
            "strain": kernel.STRAIN,
            "strength": kernel.VOLUNTARY,
        }
        for name, column in columns.items():
            values = torch.tensor(model.table[:, column])
            self.register_parameter(name, torch.nn.Parameter(values, requires_grad=False))
        # What never changes: first of the units, then of the parts, sorted by depth, then of the paths.
        self._keep("_least", model.table[:, kernel.LEAST])
        self._keep("_speed", model.table[:, kernel.SPEED])
        self._keep("_reflex_gain", model.table[:, kernel.REFLEX_GAIN])
        self._keep("_reflex_threshold", model.table[:, kernel.REFLEX_THRESHOLD])
        self._lay_paths(model, self._lay_tree(model))
        self.to(device=device, dtype=dtype)

    def _keep(self, name: str, values: Array | Ints) -> None:
        """Keep a constant tensor."""
        self.register_buffer(name, torch.tensor(values), persistent=False)

    def _lay_tree(self, model: MuscleModel) -> Ints:
        """Sort the parts by depth, and return the place of each part's frame; 0 is the pelvis."""
        count = len(model.dofs)
        depths = np.zeros(count, np.int64)
        for i, parent in enumerate(model.parents):
            depths[i] = depths[parent] + 1 if parent >= 0 else 0
        order = np.argsort(depths, kind="stable")
        place = np.empty(count, np.int64)
        place[order] = np.arange(count)
        self._level_sizes = np.bincount(depths).tolist() if count else []
        starts = np.cumsum([0, *self._level_sizes])
        for level in range(1, len(self._level_sizes)):
            members = order[starts[level] : starts[level + 1]]
            above = place[model.parents[members]] - starts[level - 1]
            self._keep(f"_above_{level}", above)
        axes, fixed = model.parts[:, AXIS : AXIS + 3], model.parts[:, ROTATION : ROTATION + 9]
        fixed = fixed.reshape(-1, 3, 3)
        along = axes[:, :, None] * axes[:, None, :]
        x, y, z = axes.T
        across = np.zeros((count, 3, 3))
        across[:, 0, 1], across[:, 0, 2], across[:, 1, 2] = -z, y, -x
        across -= across.transpose(0, 2, 1).copy()
        # The frame of a part in that before it, by angle: still + cosine * even + sine * odd.
        for name, values in (
            ("_still", fixed @ along),
            ("_even", fixed @ (np.eye(3) - along)),
            ("_odd", fixed @ across),
            ("_axes", axes),
            ("_offsets", model.parts[:, OFFSET : OFFSET + 3]),
        ):
            self._keep(name, values[order][..., None])
        self._keep("_order", order)
        return np.append(0, place + 1)

    def _lay_paths(self, model: MuscleModel, rows: Ints) -> None:
        """Lay out points, segments between them, pulleys and what crosses which DoF."""
        layout = model.layout
        self._scapulae = TorchScapulae(layout, rows)
        blades = BLADE_ROWS * len(layout.scapulae)
        rows = np.append(rows, len(rows) + np.arange(blades))
        muscles = len(model.names)
        points = len(layout.points)
        owner = np.repeat(np.arange(muscles), np.diff(layout.starts[:, 0]))
        is_end = np.ones(points, np.bool_)
        is_end[layout.starts[:-1, 0]] = False
        segment = np.cumsum(is_end) - 1  # the segment that ends in a point
        pulleys = layout.pulley_spots[:, 0]
        is_last = np.append(~is_end[1:], True)
        wraps = layout.wrap_spots[:, 0]
        crossing_owner = np.repeat(np.arange(muscles), np.diff(layout.starts[:, 1]))
        crossing, pull, sign, axis = layout.entries.T
        # Wrenches of pulleys come after those of segments.
        wrench = np.append(segment[layout.cuts[:, 0]], is_end.sum() + np.arange(len(pulleys)))
        for name, whole in (
            ("_carrier", rows[layout.rows]),
            ("_end", np.flatnonzero(is_end)),
            ("_segment_owner", owner[is_end]),
            ("_pulley_point", pulleys),
            ("_pulley_carrier", rows[layout.pulley_spots[:, 1]]),
            ("_pulley_before", rows[layout.pulley_spots[:, 2]]),
            ("_pulley_into", np.where(is_end, segment, 0)[pulleys]),
            ("_pulley_out", np.where(is_last, 0, segment + 1)[pulleys]),
            ("_wrap_point", wraps),
            ("_wrap_carrier", rows[layout.wrap_spots[:, 1]]),
            ("_wrap_owner", owner[wraps]),
            ("_wrap_into", segment[wraps]),
            ("_wrap_out", segment[wraps + 2]),
            ("_crossing_owner", crossing_owner),
            ("_crossing_dof", layout.crossed),
            ("_entry_crossing", crossing),
            ("_entry_wrench", wrench[pull]),
            ("_entry_part", rows[axis] - 1),
        ):
            self._keep(name, whole)
        for name, values in (
            ("_points", layout.points),
            ("_arm", layout.pulleys[:, ARM : ARM + 3]),
            ("_arm_before", layout.pulleys[:, ARM_BEFORE : ARM_BEFORE + 3]),
            ("_radius", layout.pulleys[:, RADIUS : RADIUS + 1]),
            ("_wrap_turn", layout.wraps[:, TURN : TURN + 9].reshape(len(wraps), 3, 3)),
            ("_wrap_centre", layout.wraps[:, CENTRE : CENTRE + 3]),
            ("_wrap_radius", layout.wraps[:, WRAP_RADIUS]),
            ("_wrap_axial", layout.wraps[:, IS_CYLINDER, None]),
            ("_has_into", is_end[pulleys, None]),
            ("_has_out", ~is_last[pulleys, None]),
            ("_entry_sign", sign),
        ):
            self._keep(name, values[..., None].astype(float))

    def new_state(self, people: int) -> TorchState:
        """Return the state of muscles at rest of n people."""
        least = self._least.expand(people, -1)
        tendon = torch.full_like(least, 1.0 if self.tendon == "implicit" else 0.0)
        return TorchState(least.clone(), tendon, torch.zeros_like(least), torch.zeros_like(least))

    def step(
        self, q: Tensor, qd: Tensor, excitation: Tensor, state: TorchState, dt: float
    ) -> tuple[Tensor, TorchState]:
        """Carry the muscles of n people on by one step.

        Args:
            q: Joint angles [rad], shape [n, d].
            qd: Joint rates [rad/s], shape [n, d].
            excitation: In [0, 1], shape [n, m].
            state: Of the step before, or from `new_state`.
            dt: Time step [s].

        Returns:
            The torques [N·m], shape [n, d], and the state after the step.

        Raises:
            ActionError: If a shape is wrong.
        """
        n, d, m = len(q), len(self.dofs), len(self.names)
        given = {
            "q": (q, (n, d)),
            "qd": (qd, (n, d)),
            "excitation": (excitation, (n, m)),
            "activation of the state": (state.activation, (n, m)),
        }
        for name, (values, shape) in given.items():
            if tuple(values.shape) != shape:
                raise ActionError(f"{name} must have shape {shape}, got {tuple(values.shape)}")
        lengths, arms = self._paths(q.t())
        spins = qd.t().index_select(0, self._crossing_dof)
        rates = -_collected(arms * spins, self._crossing_owner, m)
        activation = self._activate(state.activation.t(), excitation.t(), rates, dt)
        pull = self._pull_implicit if self.tendon == "implicit" else self._pull
        active, passive, tendon = pull(lengths, rates, activation, state.tendon.t(), dt)
        tension = (active + passive).index_select(0, self._crossing_owner)
        torques = _collected(arms * tension, self._crossing_dof, d)
        after = TorchState(activation.t(), tendon.t(), active.t(), passive.t())
        return torques.t(), after

    def lengths(self, q: Tensor) -> Tensor:
        """Return the lengths of muscles with their tendons at `q` [rad], [n, d] -> [m], [n, m]."""
        return self._paths(q.t())[0].t()

    def moment_arms(self, q: Tensor) -> Tensor:
        """Return -dL/dq at joint angles `q` [rad] of shape [n, d] [m], shape [n, m, d]."""
        arms = self._paths(q.t())[1].t()
        out = arms.new_zeros(len(q), len(self.names), len(self.dofs))
        out[:, self._crossing_owner, self._crossing_dof] = arms
        return out

    def _frames(self, q: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return rotation and origin of the pelvis, all parts and scapulae, and the screws."""
        q = q.index_select(0, self._order)[:, None, None]
        local = self._still + torch.cos(q) * self._even + torch.sin(q) * self._odd
        n = q.shape[-1]
        eye = torch.eye(3, dtype=q.dtype, device=q.device)[None, :, :, None].expand(1, 3, 3, n)
        turns, origins, first = [eye], [eye.new_zeros(1, 3, n)], 0
        for level, size in enumerate(self._level_sizes):
            turn, offset = local[first : first + size], self._offsets[first : first + size]
            if level:
                above = getattr(self, f"_above_{level}")
                before = turns[-1].index_select(0, above)
                turn = _product(before, turn)
                offset = origins[-1].index_select(0, above) + _turned(before, offset)
            turns.append(turn)
            origins.append(offset.expand(size, 3, n))
            first += size
        rotations, places = torch.cat(turns), torch.cat(origins)
        axes = _turned(rotations[1:], self._axes)
        frames = rotations, places, torch.cat((axes, _cross(places[1:], axes)), 1)
        blades = self._scapulae(rotations, places, axes)
        rotations, places, screws = (torch.cat(p) for p in zip(frames, blades, strict=True))
        return rotations, places, screws

    def _paths(self, q: Tensor) -> tuple[Tensor, Tensor]:
        """Return lengths [m, n] and the moment arm of every crossing [c, n]."""
        rotations, places, screws = self._frames(q)
        points = _turned(rotations.index_select(0, self._carrier), self._points)
        points = points + places.index_select(0, self._carrier)
        centres = points.index_select(0, self._pulley_point)
        arm = _turned(rotations.index_select(0, self._pulley_carrier), self._arm)
        middle = arm + _turned(rotations.index_select(0, self._pulley_before), self._arm_before)
        norm = 1.0 / (middle.norm(dim=1, keepdim=True) + 1e-12)
        middle = middle * norm
        points = points.index_add(0, self._pulley_point, self._radius * middle)
        points, extra, push, other = self._wrap(rotations, places, points)
        ends = points.index_select(0, self._end)
        ways = ends - points.index_select(0, self._end - 1)
        spans = ways.norm(dim=1, keepdim=True)
        ways = ways / spans.clamp(min=1e-12)
        ways = ways.index_add(0, self._wrap_into, -push).index_add(0, self._wrap_out, other)
        ends = ends.index_copy(0, self._wrap_into, points.index_select(0, self._wrap_point - 1))
        # What the rim of a pulley is pulled with; it moves by lever (I - m mT) (axis x arm).
        pulled = self._has_into * ways.index_select(0, self._pulley_into)
        pulled = pulled - self._has_out * ways.index_select(0, self._pulley_out)
        beside = pulled - (pulled * middle).sum(1, keepdim=True) * middle
        moment = _cross(centres, pulled) + _cross(arm, self._radius * norm * beside)
        wrenches = torch.cat(
            (torch.cat((_cross(ends, ways), ways), 1), torch.cat((moment, pulled), 1))
        )
        power = wrenches.index_select(0, self._entry_wrench)
        power = (power * screws.index_select(0, self._entry_part)).sum(1) * self._entry_sign
        arms = -_collected(power, self._entry_crossing, len(self._crossing_dof))
        lengths = _collected(spans[:, 0], self._segment_owner, len(self.names))
        return lengths.index_add(0, self._wrap_owner, extra), arms

    def _wrap(self, rotations: Tensor, places: Tensor, points: Tensor) -> tuple[Tensor, ...]:
        """Return points with the spots on surfaces, how much longer arcs are than chords, and pushes."""
        turns = rotations.index_select(0, self._wrap_carrier)
        origins = places.index_select(0, self._wrap_carrier)
        # From the frame of the pelvis into those of the surfaces, whose axes are rows.
        turns = _product(
            self._wrap_turn.expand(-1, -1, -1, points.shape[-1]), turns.transpose(1, 2)
        )

        def local(step: int) -> Tensor:
            away = points.index_select(0, self._wrap_point + step) - origins
            return _turned(turns, away) - _turned(self._wrap_turn, self._wrap_centre)

        first, second, extra, push, other = wrapped(
            local(-1), local(2), self._wrap_radius, self._wrap_axial
        )
        back = turns.transpose(1, 2)
        centre = _turned(self._wrap_turn, self._wrap_centre)
        both = [_turned(back, spot + centre) + origins for spot in (first, second)]
        at = torch.cat((self._wrap_point, self._wrap_point + 1))
        push, other = _turned(back, push), _turned(back, other)
        return points.index_copy(0, at, torch.cat(both)), extra, push, other

    def _activate(self, activation: Tensor, excitation: Tensor, rates: Tensor, dt: float) -> Tensor:
        least = self._least[:, None]
        stretch = rates / self.fibre[:, None] - self._reflex_threshold[:, None]
        drive = self.strength[:, None] * excitation
        drive = drive + self._reflex_gain[:, None] * stretch.clamp(min=0.0)
        wanted = torch.maximum(drive.clamp(max=1.0), least)
        span = 1.0 - least
        now, end = (activation - least) / span, (wanted - least) / span

        def after(middle: Tensor, time: float) -> Tensor:
            pace = 0.5 + 1.5 * middle
            tau = torch.where(end > now, hill.ACTIVATION_TIME * pace, hill.DEACTIVATION_TIME / pace)
            return now + (end - now) * (1.0 - torch.exp(-time / tau))

        return least + span * after(after(now, 0.5 * dt), dt)

    def _pull(
        self, lengths: Tensor, rates: Tensor, activation: Tensor, tendon: Tensor, dt: float
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Return active and passive tension [N], and tension [F_max], of an algebraic tendon."""
        force, fibre, slack = self.force[:, None], self.fibre[:, None], self.slack[:, None]
        if self.tendon == "quasi_static":
            slack = slack * tendon_length(tendon)
        along = ((lengths - slack) / fibre).clamp(min=hill.SHORTEST)
        length = torch.sqrt(along * along + self.pennation_sine[:, None] ** 2)
        cosine = along / length
        speed = (rates / (fibre * self._speed[:, None]) * cosine).clamp(-1.0, 1.0)
        contractile = activation * force_length(length) * force_velocity(speed) * cosine
        rest = (
            passive_force(length, self.strain[:, None])
            + hill.DAMPING * self._speed[:, None] * speed
        )
        rest = torch.maximum(rest * cosine, -contractile)
        return force * contractile, force * rest, contractile + rest

    def _pull_implicit(
        self, lengths: Tensor, rates: Tensor, activation: Tensor, tendon: Tensor, dt: float
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Return active and passive tension [N], and the fibre length after a backward Euler step."""
        height = self.pennation_sine[:, None]
        given = (lengths.detach(), activation.detach(), tendon.detach())
        least = (height.detach() + 1e-3).clamp(min=0.2)
        low, high = (
            torch.maximum(torch.hypot(self._beside(given[0], stretch), height.detach()), least)
            for stretch in (kernel.LONGEST_TENDON, kernel.SHORTEST_TENDON)
        )
        with torch.enable_grad():
            length = torch.minimum(torch.maximum(given[2], low), high)
            for _ in range(NEWTON_STEPS):
                trial = length.detach().requires_grad_()
                error = self._imbalance(trial, *given, dt)[0]
                (slope,) = torch.autograd.grad(error.sum(), trial)
                error = error.detach()
                high = torch.where(error > 0, torch.minimum(high, length), high)
                low = torch.where(error > 0, low, torch.maximum(low, length))
                after = length - error / slope.clamp(min=1e-9)
                after = torch.where((after > low) & (after < high), after, 0.5 * (low + high))
                moved = (after - length).abs().max()
                length = after
                if moved < NEWTON_ERROR:
                    break
        # One more step from there, with the slope held, carries the gradient of the balance.
        error = self._imbalance(length, lengths, activation, tendon, dt)[0]
        is_free = length > least + 1e-9  # a slack muscle stays as short as it can be
        length = length - torch.where(is_free, error / slope.clamp(min=1e-9), 0.0)
        _, contractile, rest = self._imbalance(length, lengths, activation, tendon, dt)
        stretched = (lengths - self._along(length)) / self.slack[:, None]
        tension = self.force[:, None] * tendon_force(stretched).clamp(min=0.0)
        both = contractile + rest
        share = torch.where(both > 1e-9, contractile / both.clamp(min=1e-9), 0.0).clamp(0.0, 1.0)
        return tension * share, tension * (1.0 - share), length

    def _beside(self, lengths: Tensor, tendon: float) -> Tensor:
        """Return the fibre along a tendon of a length [slack lengths] [optimal lengths]."""
        along = lengths - tendon * self.slack.detach()[:, None]
        return (along / self.fibre.detach()[:, None]).clamp(min=0.0)

    def _along(self, length: Tensor) -> Tensor:
        """Return the fibre along the tendon [m]."""
        return length * self.fibre[:, None] * self._cosine(length)

    def _cosine(self, length: Tensor) -> Tensor:
        return torch.sqrt((1.0 - (self.pennation_sine[:, None] / length) ** 2).clamp(min=1e-4))

    def _imbalance(
        self, length: Tensor, lengths: Tensor, activation: Tensor, old: Tensor, dt: float
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Return fibre less tendon force at a fibre length, and both fibre forces [F_max]."""
        speed = ((length - old) / (dt * self._speed[:, None])).clamp(-1.0, 1.0)
        contractile = activation * force_length(length) * force_velocity(speed)
        rest = (
            passive_force(length, self.strain[:, None])
            + hill.DAMPING * self._speed[:, None] * speed
        )
        tendon = tendon_force((lengths - self._along(length)) / self.slack[:, None])
        return (contractile + rest) * self._cosine(length) - tendon, contractile, rest


def force_length(length: Tensor) -> Tensor:
    """Return f_L by fibre length [optimal lengths]; see `hill.active_curve`."""
    one = (length - hill._B21) / (hill._B31 + hill._B41 * length)
    two = (length - hill._B22) / (hill._B32 + hill._B42 * length)
    three = (length - hill._B23) / hill._B33
    total = hill._B11 * torch.exp(-0.5 * one * one) + hill._B12 * torch.exp(-0.5 * two * two)
    return total + hill._B13 * torch.exp(-0.5 * three * three)


def force_velocity(speed: Tensor) -> Tensor:
    """Return f_V by fibre speed [ten optimal lengths/s]; see `hill.speed_curve`."""
    x = hill._D2 * speed + hill._D3
    return hill._D1 * torch.log(x + torch.sqrt(x * x + 1.0)) + hill._D4


def passive_force(length: Tensor, strain: Tensor) -> Tensor:
    """Return f_PE by fibre length [optimal lengths]; see `hill.passive_curve`."""
    shape = hill._PASSIVE_SHAPE
    offset = torch.exp(shape * (hill._PASSIVE_START - 1.0) / strain)
    scale = hill._PASSIVE_TOP - offset
    curved = torch.minimum(length, 1.0 + strain)  # so that the unused branch stays finite
    curve = (torch.exp(shape * (curved - 1.0) / strain) - offset) / scale
    line = 1.0 + hill._PASSIVE_TOP * shape / (strain * scale) * (length - 1.0 - strain)
    return torch.where(length <= 1.0 + strain, curve, line.clamp(max=hill.PASSIVE_CAP))


def tendon_force(length: Tensor) -> Tensor:
    """Return f_T by tendon length [slack lengths]; see `hill.tendon_curve`."""
    grown = hill._TENDON_C1 * torch.exp(hill._TENDON_SHAPE * (length - hill._TENDON_C2))
    return grown - hill._TENDON_C3


def tendon_length(force: Tensor) -> Tensor:
    """Return the tendon length [slack lengths] by its force [F_max]: the inverse of f_T."""
    stretch = torch.log((force + hill._TENDON_C3) / hill._TENDON_C1) / hill._TENDON_SHAPE
    return hill._TENDON_C2 + stretch


def _collected(values: Tensor, place: Tensor, count: int) -> Tensor:
    """Return sums of rows by place, shape [count, n]."""
    return values.new_zeros(count, values.shape[1]).index_add(0, place, values)


def _turned(rotations: Tensor, vectors: Tensor) -> Tensor:
    """Return R v: [k, 3, 3, n] and [k, 3, n or 1] -> [k, 3, n]."""
    return (rotations * vectors[:, None]).sum(2)


def _product(a: Tensor, b: Tensor) -> Tensor:
    """Return A B of matrices of shape [k, 3, 3, n]."""
    return sum((a[:, :, i, None] * b[:, i, None] for i in (1, 2)), a[:, :, 0, None] * b[:, 0, None])


def _cross(a: Tensor, b: Tensor) -> Tensor:
    """Return a x b of vectors of shape [k, 3, n]."""
    return torch.linalg.cross(a, b, dim=1)
