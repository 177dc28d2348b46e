"""How a person is built, from where straight arms reach: robust least squares about published proportions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array

from ..upper_body import SHOULDER_HALF_WIDTH, SIGN, UpperBody, arm_angles, girdle

Seen = tuple[str, Array, Array]  # side, palm from the middle of the shoulders [m], fingers [3]

# Ears are so far in front of the line of the shoulders in who sits or stands at ease, and the neck turns
# below them [stature]; our own choice, of what is written about forward heads.
BEHIND = 0.015
# All our own choice. Standard deviations between people, as shares of stature: half the width of the
# shoulders, shoulders against head along the trunk, forward and to the left, reach of a straight arm; and how
# far shoulders move with arms against the average. To the left: how a headset sits, and who holds it.
BETWEEN = np.array((0.007, 0.012, 0.02, 0.012, 0.016, 0.4))
ASIDE, FIXED = np.arange(6) == 3, 1e-6
RAISED = math.cos(
    math.radians(45)
)  # a palm less below the shoulders than this share of how far it is
STRAIGHT = math.radians(40)  # who bends wrist or elbow by less has an arm that counts
CLOSE, SHORT = (
    0.010,
    0.035,
)  # an arm reaches this exactly; one that is bent falls short by so much [stature]
ROUNDS = 4
TELLING = 0.35  # share of its first variance from which the reach counts as measured
SLACK_UNKNOWN, SLACK_KNOWN = 0.06, 0.025  # what is not known of a distance, as a share of it
MOST_LIFT = 2.5  # how far shoulders move with arms at most, against the average
OWN_SHARE, OWN_GAP = (
    0.4,
    0.06,
)  # a length differs from the usual by no more: shares of it, or of the stature
OFF_UNKNOWN, OFF_KNOWN = math.radians(6), math.radians(3.5)  # and of a direction [rad]


@dataclass(frozen=True, eq=False)
class BodyFit:
    """A body as far as it is known.

    Attributes:
        body: Its lengths.
        height: The stature that was told [m].
        forward: How far the shoulders are in front of the line from hips to neck [m].
        aside: How far their middle is to the left of it [m]; of one sitting, so it is not kept.
        lift: How far shoulders move as arms are raised, against the average.
        of_reach: Standard deviation of a distance from shoulder to wrist, as a share of it.
        of_direction: Of where a straight arm points [rad].
        is_measured: Whether arms were seen that tell lengths; else they are those of the stature.
    """

    body: UpperBody
    height: float
    forward: float = 0.0
    aside: float = 0.0
    lift: float = 1.0
    of_reach: float = SLACK_UNKNOWN
    of_direction: float = OFF_UNKNOWN
    is_measured: bool = False

    def to_dict(self) -> dict[str, float]:
        """Return the numbers of a measured body, to keep for the person's next session."""
        own = {name: getattr(self, name) for name in ("height", "forward", "lift")}
        return {name: round(float(value), 4) for name, value in (own | vars(self.body)).items()}

    @classmethod
    def from_dict(cls, numbers: Mapping[str, float]) -> BodyFit:
        """Return the measured body of the numbers of `to_dict`.

        Raises:
            ConfigError: If they are others, or do not fit the stature that is among them.
        """
        names = {"height", "forward", "lift", *(each.name for each in fields(UpperBody))}
        if set(numbers) != names:
            raise ConfigError(f"a body has the numbers {', '.join(sorted(names))}")
        left = dict(numbers)
        height, forward, lift = (left.pop(name) for name in ("height", "forward", "lift"))
        usual, body = UpperBody.of_height(height), UpperBody(**left)
        for name, value in vars(usual).items():
            gap = max(OWN_SHARE * value, OWN_GAP * height)
            if abs(left[name] - value) > gap:
                raise ConfigError(
                    f"{name} of {left[name]:g} m does not fit a stature of {height:g} m: it is "
                    f"{max(value - gap, 0.0):.3f} to {value + gap:.3f} m"
                )
        if not (abs(forward) <= 0.2 * height and 0.0 <= lift <= MOST_LIFT):
            raise ConfigError(
                f"shoulders lie within {0.2 * height:.2f} m of the trunk's line and move 0 to {MOST_LIFT:g} "
                f"times the average, got {forward:g} m and {lift:g}"
            )
        return cls(body, height, forward, 0.0, lift, SLACK_KNOWN, OFF_KNOWN, True)

    @classmethod
    def of(cls, body: UpperBody, height: float) -> BodyFit:
        """Return what is known of a stature [m] alone."""
        return cls(body, height, -BEHIND * height)

    def shoulder(self, side: str, elevation: float, plane: float) -> Array:
        """Return where a shoulder is from the middle of both, its arm raised so [m], shape [3]."""
        scale = self.lift * self.body.shoulder / SHOULDER_HALF_WIDTH
        lift = girdle(side, elevation, plane) * scale
        return np.asarray(lift + np.array((0.0, SIGN[side] * self.body.shoulder, 0.0)))

    def refined(self, seen: Sequence[Seen]) -> BodyFit:
        """Return this fit with what straight arms tell of width, height and place of shoulders, and reach.

        Gauss-Newton with the proportions of the stature as a prior; arms that reach less than they could
        count as bent and pull the less (an asymmetric, Huber-like weight).

        Args:
            seen: Palms and fingers in the frame of the trunk, of either side.

        Raises:
            ConfigError: If what arms reach does not fit the stature.
        """
        if not seen:
            return self
        unit, body = self.height, self.body
        signs = np.array([SIGN[side] for side, _, _ in seen])
        palms, fingers = (np.array([each[k] for each in seen]) for k in (1, 2))
        place = (body.shoulder, 0.0, self.forward, self.aside)
        prior = np.array((*place, body.reach, self.lift * unit)) / unit
        value = prior.copy()
        # One raised arm alone does not tell a place aside from wide shoulders.
        raised = signs[palms[:, 2] > -RAISED * np.linalg.norm(palms, axis=1)]
        between = np.where(ASIDE & (len(set(raised)) < 2), FIXED, BETWEEN)
        precision = np.diag(1 / between**2)
        for _ in range(ROUNDS):
            width, down, forward, aside, reach = value[:5] * unit
            lift = np.zeros((len(seen), 3))
            ones = np.ones(len(seen))
            at = np.column_stack((forward * ones, aside + signs * width, -down * ones))
            for side, sign in SIGN.items():
                own = signs == sign
                elevation, plane = arm_angles(side, palms[own] - at[own])
                lift[own] = girdle(side, elevation, plane) * (width / SHOULDER_HALF_WIDTH)
            gap = palms - at - value[5] * lift
            far = np.linalg.norm(gap, axis=1)
            along = gap / np.maximum(far, 1e-6)[:, None]
            is_straight = (along * fingers).sum(axis=1) > math.cos(STRAIGHT)
            error = (reach - far) / unit
            about = np.where(error > 0, SHORT, CLOSE)
            weight = is_straight / about**2 / np.maximum(1.0, np.abs(error) / (2 * about))
            # Frames are not independent: each second of them counts as a few.
            weight *= min(1.0, 120.0 / max(float(is_straight.sum()), 1.0))
            by_lift = (along * lift).sum(axis=1) / unit
            by_place = (signs * along[:, 1], -along[:, 2], along[:, 0], along[:, 1])
            rows = np.column_stack((*by_place, ones, by_lift))
            left = np.diag(1 / between**2) + (rows * weight[:, None]).T @ rows
            right = (rows * weight[:, None]).T @ error + (value - prior) / between**2
            value = value - np.linalg.solve(left, right)
            precision = left
        left_over = np.diag(np.linalg.inv(precision)) / between**2
        share = value[4] * unit / body.reach
        if not 0.75 <= share <= 1.25:
            raise ConfigError(
                f"arms that reach {value[4] * unit:.2f} m do not fit a stature of {unit:.2f} m"
            )
        measured = bool(left_over[4] < TELLING)
        lengths = {n: getattr(body, n) * share for n in ("upper_arm", "forearm", "palm")}
        fitted = replace(
            body,
            **lengths,
            shoulder=float(value[0] * unit),
            trunk=body.trunk - float(value[1] * unit),
            neck=max(body.neck + float(value[1] * unit), 1e-3),
        )
        return replace(
            self,
            body=fitted,
            forward=float(value[2] * unit),
            aside=float(value[3] * unit),
            lift=float(np.clip(value[5], 0.0, MOST_LIFT)),
            of_reach=SLACK_KNOWN if measured else SLACK_UNKNOWN,
            of_direction=OFF_KNOWN if measured else OFF_UNKNOWN,
            is_measured=measured,
        )
