"""What a person goes through in an episode, measured alike in every task.

Forces are those of what can press: robots, tools, other people, cloth and whatever else moves. A bed or
a chair carries, and does not count.

`cost` is one number a control step for constrained learning: how far force, joint angle and speed
exceeded what is comfortable, each as a share of the way to its limit.
"""

from __future__ import annotations

import math
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rcare_marl.agents.people.human import Human
from rcare_marl.agents.people.physiology_model import REGIONS, physiology_model
from rcare_marl.body import Body
from rcare_marl.pose import Array
from rcare_marl.separation import Near
from rcare_marl.world import World

from .broadcast import clip

# [N] above which a touch costs, as a share of the limit of the task; our own choice.
COMFORT_SHARE = 0.5
# [m²] over which a touch spreads at least: a fingertip, 1 cm²; our own choice. Bullet's contacts are points.
LEAST_PATCH = 1e-4
NEAR = 0.2  # [m] from the person, within which robots should be slow; our own choice
# [m/s] of a robot near a person: reduced speed of ISO 10218-1 (250 mm/s); from memory.
SLOW, FAST = 0.25, 1.0
WATCHED = 0.06  # [m] from the person, within which arms are to be kept clear; our own choice
PROM_LIMIT_DEG = 10.0  # beyond the passive range, where the cost is full; our own choice
PEAKS = tuple(f"peak_force_{region}_n" for region in REGIONS)  # keys of what is reported
WEIGHTS = {"force": 1.0, "prom": 1.0, "speed": 0.5}  # of the shares in `cost`; our own choice


@dataclass(frozen=True, eq=False)
class Safety:
    """What a person went through until the end of a control step.

    Attributes:
        force: Greatest summed force of any physics step in the control step [N].
        peak_force: Greatest force of the episode [N].
        mean_force: Mean force while something touched the person [N].
        peaks: Greatest force on each of `REGIONS` [N], shape [r].
        pressure: Greatest pressure [Pa].
        beyond_deg: How far joints are beyond their passive ranges now, summed [degrees].
        prom_deg_s: That, over time [degrees s].
        speed: How fast the mover came closer that did so fastest, of those that are near [m/s].
        top_speed: The greatest such speed of the episode [m/s].
        pain: Greatest pain of the episode, 0 to 10.
    """

    force: float = 0.0
    peak_force: float = 0.0
    mean_force: float = 0.0
    peaks: Array = field(default_factory=lambda: np.zeros(len(REGIONS)))
    pressure: float = 0.0
    beyond_deg: float = 0.0
    prom_deg_s: float = 0.0
    speed: float = 0.0
    top_speed: float = 0.0
    pain: float = 0.0

    def cost(self, force_limit: float) -> Any:
        """Return what the control step cost, 0 to the sum of `WEIGHTS`; in full at the limit [N]."""
        comfort = COMFORT_SHARE * force_limit
        shares = {
            "force": (self.force - comfort) / (force_limit - comfort),
            "prom": self.beyond_deg / PROM_LIMIT_DEG,
            "speed": (self.speed - SLOW) / (FAST - SLOW),
        }
        return sum(WEIGHTS[key] * clip(value, 0.0, 1.0) for key, value in shares.items())

    def metrics(self, force_limit: float) -> dict[str, Any]:
        """Return what is reported of the episode so far, the same keys in every task."""
        is_one = self.peaks.ndim == 1
        peaks = self.peaks.tolist() if is_one else [self.peaks[..., k] for k in range(len(REGIONS))]
        return {
            "force_n": self.force,
            "peak_force_n": self.peak_force,
            "mean_force_n": self.mean_force,
            **dict(zip(PEAKS, peaks, strict=True)),
            "peak_pressure_pa": self.pressure,
            "prom_violation_deg_s": self.prom_deg_s,
            "approach_speed_m_s": self.top_speed,
            "pain": self.pain,
            "cost": self.cost(force_limit),
        }


class SafetyMeter:
    """Measures one person over an episode."""

    def __init__(self, person: Human, world: World, movers: Sequence[Body]) -> None:
        """Prepare for a person who stands, sits or lies in `world`.

        Args:
            person: Who is measured.
            world: Where they are.
            movers: Robots and tools whose speed near the person counts.
        """
        self._person, self._world = person, world
        self._movers = [(body, link) for body in movers for link in moving_links(body)]
        self._spared = {body.uid for body in person.supports} | {person.body.uid}
        if not person.rides:  # who rides can be driven against what stands still
            self._spared |= {b.uid for b in world.bodies if not (b.joints or b.is_movable)}
        model = physiology_model()
        self._region = {joint: model.region(joint) for joint in person.segments}
        self._range = person.passive.tolist()
        self.reset()

    def reset(self) -> None:
        """Begin an episode."""
        self._step_force = self._impulse = self._touch_time = self._pressure = 0.0
        self._peaks = dict.fromkeys(REGIONS, 0.0)
        self._gaps: list[float] = []

    def after_substep(self) -> None:
        """Look at the contacts of a physics step."""
        found = self._world.pressing(self._person.body, self._spared)
        if not found:
            return
        forces: dict[str, float] = {}
        points: dict[str, list[tuple[float, ...]]] = {}
        for link, position, force in found:
            joint = self._person.segment_at(link, np.array(position))
            forces[joint] = forces.get(joint, 0.0) + force
            points.setdefault(joint, []).append(position)
        regions = dict.fromkeys(REGIONS, 0.0)
        for joint, force in forces.items():
            regions[self._region[joint]] += force
            self._pressure = max(self._pressure, force / patch_area(points[joint]))
        for region, force in regions.items():
            self._peaks[region] = max(self._peaks[region], force)
        total = sum(forces.values())
        self._step_force = max(self._step_force, total)
        self._impulse += total * self._world.physics_dt
        self._touch_time += self._world.physics_dt

    def read(self, before: Safety, duration: float) -> Safety:
        """Return what was measured until the end of a control step.

        Args:
            before: What was measured until it began.
            duration: Its length [s].
        """
        force, self._step_force = self._step_force, 0.0
        over = 0.0
        for angle, (low, high) in zip(self._person.positions, self._range, strict=True):
            if not low <= angle <= high:
                over += max(low - angle, angle - high)
        beyond, speed = math.degrees(over), self._approach(duration)
        return Safety(
            force=force,
            peak_force=max(before.peak_force, force),
            mean_force=self._impulse / self._touch_time if self._touch_time else 0.0,
            peaks=np.array(list(self._peaks.values())),
            pressure=self._pressure,
            beyond_deg=beyond,
            prom_deg_s=before.prom_deg_s + beyond * duration,
            speed=speed,
            top_speed=max(before.top_speed, speed),
            pain=max(before.pain, self._person.physiology.pain),
        )

    def _approach(self, duration: float) -> float:
        """Return how fast the link of a mover that is near came closer, of the fastest [m/s].

        Link by link: else the foot of an arm beside the person would hide its hand.
        """
        before = self._gaps
        person = self._person.body
        self._gaps = self._world.gaps(self._movers, person, within=NEAR, before=before)
        pairs = zip(before, self._gaps, strict=False)
        return max([0.0, *[(a - b) / duration for a, b in pairs if b < NEAR]])

    def near(self, robot: Body, spared: Container[int]) -> list[Near]:
        """Return where links of a robot, but for some, were within 6 cm of the person at the last `read`."""
        person, world = self._person.body, self._world
        close = [
            link
            for (body, link), gap in zip(self._movers, self._gaps, strict=True)
            if gap < WATCHED and body is robot and link not in spared
        ]
        return [
            near
            for link in close
            for near in world.near(robot, person, within=WATCHED, links=(link, None))
        ]


def patch_area(points: Sequence[Sequence[float]]) -> float:
    """Return the area over which points of contact spread [m²], a fingertip at least.

    It is that of the box about them along the axes, without its shortest edge.
    """
    _, middle, longest = np.sort(np.ptp(np.array(points), axis=0)).tolist()
    return max(middle * longest, LEAST_PATCH)


def moving_links(body: Body) -> list[int]:
    """Return the links with a collision shape that can move, the base among them if it is free."""
    if body.is_movable:
        return body.solid_links()
    carried = {link for joint in body.joints.values() for link in body.carried_by(joint.index)}
    return [link for link in body.solid_links() if link in carried]


# What is reported of a scene without people, under the keys of `Safety.metrics`.
NOBODY: Mapping[str, float] = {key: float(value) for key, value in Safety().metrics(1.0).items()}
