"""Synthetic people who exercise: bodies of their own, and ways of their own to move.

Nobody here knows how a recogniser works. Proportions are those of surveys with the spread between people;
all other ranges are our own choice, of what a therapist would call right: at least 87 % of the range
shown, at 0.6 to 1.6 of its duration.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rcare_marl.agents.coaching.upper_body import SIDES, Sex, UpperBody
from rcare_marl.pose import Array

RANGE = (0.87, 1.10)  # share of the range shown that is right
PACE = (0.62, 1.58)  # duration against the one shown that is right
# Stature of women and men [m]: mean and spread (ANSUR II, from memory); lengths at a given stature spread
# by shares.
STATURE = {"female": (1.63, 0.065), "male": (1.755, 0.07)}
SPREAD = {"trunk": 0.04, "shoulder": 0.055, "arm": 0.035, "forearm": 0.02, "neck": 0.1}
SPLITS = ("development", "test")  # thresholds and weights are chosen on the first alone
# Rest of the arms [deg]: elevation, plane, rotation, elbow flexion, pronation.
RESTS = {
    "hanging": (8.0, 40.0, 0.0, 12.0, 10.0),
    "lap": (24.0, 65.0, 25.0, 62.0, 60.0),
    "armrest": (22.0, 40.0, 0.0, 75.0, 70.0),
}


@dataclass(frozen=True, eq=False)
class SyntheticUser:
    """Somebody who exercises.

    Attributes:
        height: Stature [m].
        body: Their body.
        handed: Side of the hand they use most.
        span_known: Whether they can spread their arms to be measured.
        pace: Duration of their movements against those shown.
        range: Share of the range shown that they use.
        weaker: How much less of it the other arm does.
        lag: How much later the other arm is [s].
        hold: How long they hold against what was shown.
        plane: How far out of the plane shown each arm is [rad], shape [2], + to the front.
        elbow: How much more than shown each elbow is bent [rad], shape [2].
        wrist: How each hand is bent at the wrist [rad], shape [2, 2]: towards the palm, towards the thumb.
        lift: How far the shoulders move with the arms, against the average.
        skew: Whether speed is greatest early (below 1) or late in a movement.
        jerky: How often a movement is made of several, 0 to 1.
        pauses: How often somebody stops on the way, 0 to 1.
        hurries: Whether they begin the next repetition without rest.
        tires: Share of the range that is lost over a set of ten.
        rest: Angles of both arms at rest [rad], shape [2, 5].
        tremor: Amplitude of the tremor of each arm and of the head [rad], shape [3].
        tremor_rate: Its frequency [Hz].
        sway: How far the trunk moves with the arms [rad], shape [3].
        gaze: How far the head wanders [rad], shape [3].
    """

    height: float
    body: UpperBody
    handed: str
    span_known: bool
    pace: float
    range: float
    weaker: float
    lag: float
    hold: float
    plane: Array
    elbow: Array
    wrist: Array
    lift: float
    skew: float
    jerky: float
    pauses: float
    hurries: bool
    tires: float
    rest: Array
    tremor: Array
    tremor_rate: float
    sway: Array
    gaze: Array


def draw_user(rng: np.random.Generator) -> SyntheticUser:
    """Return somebody drawn at random."""
    sex: Sex = "female" if rng.random() < 0.5 else "male"
    height = float(np.clip(rng.normal(*STATURE[sex]), 1.45, 1.98))
    body = _body(height, sex, rng)
    degree = np.pi / 180
    style = RESTS[str(rng.choice(list(RESTS)))]
    spread = (4.0, 10.0, 6.0, 8.0, 10.0)
    trembles = (
        rng.random() < 0.4
    )  # 4 to 6 Hz as in Parkinson's disease; the amplitude is our own choice
    amplitude = rng.uniform(0.5, 2.0) if trembles else rng.uniform(0.0, 0.3)
    return SyntheticUser(
        height=height,
        body=body,
        handed=SIDES[int(rng.random() < 0.9)],
        span_known=bool(rng.random() < 0.75),
        pace=float(rng.uniform(0.7, 1.45)),
        range=float(rng.uniform(0.92, 1.05)),
        weaker=float(rng.uniform(0.0, 0.05)),
        lag=float(rng.uniform(0.0, 0.15)),
        hold=float(rng.uniform(0.4, 1.6)),
        plane=rng.uniform(-8, 8, size=2) * degree,
        elbow=rng.uniform(0, 15, size=2) * degree,
        wrist=rng.uniform((-15, -8), (15, 8), size=(2, 2)) * degree,
        lift=float(rng.uniform(0.5, 1.7)),
        skew=float(rng.uniform(0.75, 1.35)),
        jerky=float(rng.uniform(0.0, 0.6)),
        pauses=float(rng.uniform(0.0, 0.3)),
        hurries=bool(rng.random() < 0.3),
        tires=float(rng.uniform(0.0, 0.1)),
        rest=np.clip(rng.normal(style, spread, size=(2, 5)), -20, 95) * degree,
        tremor=amplitude * degree * rng.uniform((0.5, 0.5, 0.1), (1.0, 1.0, 0.4)),
        tremor_rate=float(rng.uniform(4.0, 6.0)),
        sway=rng.uniform(0.0, 4.0, size=3) * degree,
        gaze=rng.uniform(1.0, 6.0, size=3) * degree,
    )


def _body(height: float, sex: Sex, rng: np.random.Generator) -> UpperBody:
    """Return a body of a stature [m] with proportions of its own."""
    usual = UpperBody.of_height(height, sex=sex)
    own = {
        name: float(np.clip(rng.normal(1.0, sd), 1 - 2 * sd, 1 + 2 * sd))
        for name, sd in SPREAD.items()
    }
    return replace(
        usual,
        trunk=usual.trunk * own["trunk"],
        shoulder=usual.shoulder * own["shoulder"],
        upper_arm=usual.upper_arm * own["arm"],
        forearm=usual.forearm * own["arm"] * own["forearm"],
        palm=usual.palm * own["arm"],
        neck=usual.neck * own["neck"],
    )


def draw_person(number: int, *, seed: int, split: str = "test") -> SyntheticUser:
    """Return one of the people of a seed; the same seed gives other people in another split."""
    return draw_user(np.random.default_rng((SPLITS.index(split), seed, number, 0)))


def draw_users(count: int, *, seed: int, split: str = "test") -> tuple[SyntheticUser, ...]:
    """Return the first people of a seed."""
    return tuple(draw_person(i, seed=seed, split=split) for i in range(count))
