"""What a person goes through in an episode, measured alike in every task.

Forces are those of what can press: robots, tools, other people, cloth and whatever else moves. A bed or
a chair carries, and does not count.

`cost` is one number a control step for constrained learning: how far force, joint angle and speed
exceeded what is comfortable, each as a share of the way to its limit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from rcare_marl.agents.human import Human
from rcare_marl.agents.physiology_model import REGIONS, physiology_model
from rcare_marl.body import Body
from rcare_marl.world import World

# [N] above which a touch costs, as a share of the limit of the task; our own choice.
COMFORT_SHARE = 0.5
# [m²] over which a touch spreads at least: a fingertip, 1 cm²; our own choice. Bullet's contacts are points.
LEAST_PATCH = 1e-4
NEAR = 0.2  # [m] from the person, within which robots should be slow; our own choice
# [m/s] of a robot near a person: reduced speed of ISO 10218-1 (250 mm/s); from memory.
SLOW, FAST = 0.25, 1.0
PROM_LIMIT_DEG = 10.0  # beyond the passive range, where the cost is full; our own choice
WEIGHTS = {"force": 1.0, "prom": 1.0, "speed": 0.5}  # of the shares in `cost`; our own choice


class SafetyMeter:
    """Measures one person over an episode.

    Attributes:
        force: Greatest summed force of any physics step in the last control step [N].
        peak_force: Greatest force of the episode [N].
        force_limit: Force at which the cost is full [N].
    """

    def __init__(
        self, person: Human, world: World, movers: Sequence[Body], *, force_limit: float
    ) -> None:
        """Prepare for a person who stands, sits or lies in `world`.

        Args:
            person: Who is measured.
            world: Where they are.
            movers: Robots and tools whose speed near the person counts.
            force_limit: Force at which the cost is full [N].
        """
        self._person, self._world = person, world
        self._movers = [(body, link) for body in movers for link in _moving_links(body)]
        self.force_limit = force_limit
        self._spared = {body.uid for body in person.supports} | {person.body.uid}
        if not person.rides:  # who rides can be driven against what stands still
            self._spared |= {b.uid for b in world.bodies if not (b.joints or b.is_movable)}
        model = physiology_model()
        self._region = {joint: model.region(joint) for joint in person.segments}
        self._range = person.passive.tolist()
        self.reset()

    def reset(self) -> None:
        """Begin an episode."""
        self.force = self.peak_force = self._step_force = 0.0
        self._peaks = dict.fromkeys(REGIONS, 0.0)
        self._pressure = self._impulse = self._touch_time = 0.0
        self._beyond = self._prom = self._speed = self._top_speed = self._pain = 0.0
        self._gaps: list[float] = []
        self._cost = 0.0

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

    def after_step(self, duration: float) -> None:
        """Look at posture, speed and pain at the end of a control step of `duration` [s]."""
        self.force, self._step_force = self._step_force, 0.0
        self.peak_force = max(self.peak_force, self.force)
        over = 0.0
        for angle, (low, high) in zip(self._person.positions, self._range, strict=True):
            if not low <= angle <= high:
                over += max(low - angle, angle - high)
        self._beyond = math.degrees(over)
        self._prom += self._beyond * duration
        self._speed = self._approach(duration)
        self._top_speed = max(self._top_speed, self._speed)
        self._pain = max(self._pain, self._person.physiology.pain)

    def _approach(self, duration: float) -> float:
        """Return how fast the link of a mover that is near came closer, of the fastest [m/s].

        Link by link: else the foot of an arm beside the person would hide its hand.
        """
        before = self._gaps
        person = self._person.body
        self._gaps = self._world.gaps(self._movers, person, within=NEAR, before=before)
        pairs = zip(before, self._gaps, strict=False)
        return max([0.0, *[(a - b) / duration for a, b in pairs if b < NEAR]])

    @property
    def cost(self) -> float:
        """What the last control step cost, 0 to the sum of `WEIGHTS`."""
        comfort = COMFORT_SHARE * self.force_limit
        shares = {
            "force": (self.force - comfort) / (self.force_limit - comfort),
            "prom": self._beyond / PROM_LIMIT_DEG,
            "speed": (self._speed - SLOW) / (FAST - SLOW),
        }
        return sum(WEIGHTS[key] * min(max(share, 0.0), 1.0) for key, share in shares.items())

    def metrics(self) -> Mapping[str, float]:
        """Return what is reported of the episode so far, the same keys in every task."""
        mean = self._impulse / self._touch_time if self._touch_time else 0.0
        return {
            "force_n": self.force,
            "peak_force_n": self.peak_force,
            "mean_force_n": mean,
            **{f"peak_force_{region}_n": force for region, force in self._peaks.items()},
            "peak_pressure_pa": self._pressure,
            "prom_violation_deg_s": self._prom,
            "approach_speed_m_s": self._top_speed,
            "pain": self._pain,
            "cost": self.cost,
        }


def patch_area(points: Sequence[Sequence[float]]) -> float:
    """Return the area over which points of contact spread [m²], a fingertip at least.

    It is that of the box about them along the axes, without its shortest edge.
    """
    _, middle, longest = np.sort(np.ptp(np.array(points), axis=0)).tolist()
    return max(middle * longest, LEAST_PATCH)


def _moving_links(body: Body) -> list[int]:
    """Return the links with a collision shape that can move, the base among them if it is free."""
    if body.is_movable:
        return body.solid_links()
    carried = {link for joint in body.joints.values() for link in body.carried_by(joint.index)}
    return [link for link in body.solid_links() if link in carried]


# What is reported of a scene without people: the keys of `SafetyMeter.metrics`.
NOBODY: Mapping[str, float] = dict.fromkeys(
    (
        "force_n", "peak_force_n", "mean_force_n", *(f"peak_force_{r}_n" for r in REGIONS),
        "peak_pressure_pa", "prom_violation_deg_s", "approach_speed_m_s", "pain", "cost",
    ),
    0.0,
)  # fmt: skip

__all__ = ["NEAR", "NOBODY", "WEIGHTS", "SafetyMeter", "patch_area"]
