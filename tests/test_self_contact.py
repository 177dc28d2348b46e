"""Limbs of a person meet the trunk, the head and each other, and nobody is hurt by touching themselves."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from rcare_marl import assets
from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.body.self_contact import meeting_links
from rcare_marl.agents.people.body.skeleton import JOINT_INDEX, JOINTS, SIDES
from rcare_marl.agents.people.human import Human
from rcare_marl.pose import Pose
from rcare_marl.world import World

ARMS = [f"{side}_{joint}" for side in SIDES for joint in ("shoulder", "elbow", "wrist")]
CONTROL = 0.1  # [s]
DEEPEST = 0.01  # [m]


def moved(person: Human, world: World, angles: dict[str, float], seconds: float) -> float:
    """Pursue angles and return how deep forearms and hands have been in trunk, head and thighs [m]."""
    parts = ("pelvis", "spine1", "spine2", "spine3", "head", "left_hip", "right_hip")
    arms = [f"{side}_{joint}" for side in SIDES for joint in ("elbow", "wrist")]
    links = {name: person.frames[JOINT_INDEX[name]].link for name in (*parts, *arms)}
    pairs = {(links[a], links[b]) for a, b in product(arms, parts)}
    deepest = 0.0
    for _ in range(round(seconds / CONTROL)):
        person.command(person.action_towards(angles, CONTROL), CONTROL)
        for _ in range(round(CONTROL / world.physics_dt)):
            person.actuate()
            world.step()
        person.sense()
        deepest = max(deepest, *(-person.body.own_gap(a, b) for a, b in pairs))
    return deepest


@pytest.mark.parametrize("avatar", ["caregiver", "kim", "daniel"])
def test_arms_that_are_flung_about_stay_out_of_the_body(avatar: str) -> None:
    world = World()
    person = Human("person", load_avatar(avatar), posture=load_posture("wheelchair"), movable=ARMS)
    person.spawn(world, Pose((0.0, 0.0, 1.0)))
    rng = np.random.default_rng(5)
    for _ in range(4):
        angles = {d: float(rng.uniform(*person.active[i])) for i, d in enumerate(person.movable)}
        assert moved(person, world, angles, 1.5) < DEEPEST
    world.close()


def test_a_hand_that_is_pressed_on_the_belly_stays_outside_and_hurts_nobody() -> None:
    world = World()
    person = Human(
        "person", load_avatar("caregiver"), posture=load_posture("standing"), movable=ARMS
    )
    person.spawn(world, Pose())
    across = {"right_shoulder_external_rotation": -1.2, "right_elbow_flexion": 2.2}
    assert moved(person, world, across, 3.0) < DEEPEST
    touching = world.contacts(person.body, person.body)
    assert sum(contact.force for contact in touching) > 1.0
    assert world.contact_force(person.body) == 0.0 and not world.pressing(person.body)
    assert person.contact_forces() == {} and not world.touches(
        person.body
    )  # nor do sensors feel it
    world.close()


def test_flung_arms_move_alike_after_other_episodes_and_in_a_fresh_world() -> None:
    def made() -> tuple[World, Human]:
        world = World()
        person = Human("person", load_avatar("kim"), posture=load_posture("standing"), movable=ARMS)
        person.spawn(world, Pose())
        world.mark_start()
        return world, person

    def flung(world: World, person: Human, seed: int, steps: int) -> tuple[list[float], int]:
        """Return all states in a row, and in how many of them something touches itself."""
        world.rewind()
        rng = np.random.default_rng(seed)
        person.reset(rng)
        states: list[float] = []
        touching = 0
        for _ in range(steps):
            person.command(rng.uniform(-1, 1, person.action_size), CONTROL)
            for _ in range(round(CONTROL / world.physics_dt)):
                person.actuate()
                world.step()
                states.extend(person.body.state())
            touching += bool(world.contacts(person.body, person.body))
        return states, touching

    (world, person), (fresh, other) = made(), made()
    for seed in range(3):
        flung(world, person, 10 + seed, 1 + 7 * seed)
        states, touching = flung(world, person, seed, 20)
        assert flung(fresh, other, seed, 20) == (states, touching)
        assert touching > 3
    world.close()
    fresh.close()


@pytest.mark.slow
@pytest.mark.parametrize("posture", assets.names("postures"))
def test_nobody_begins_inside_themselves(posture: str) -> None:
    for name in assets.names("avatars"):
        world = World()
        person = Human("person", load_avatar(name), posture=load_posture(posture), movable=ARMS)
        person.spawn(world, Pose())
        parts: dict[int, list[str]] = {}
        for joint, frame in zip(JOINTS, person.frames, strict=True):
            if person.segments[joint].shapes:
                parts.setdefault(frame.link, []).append(joint)
        inside = [pair for pair in meeting_links(parts) if person.body.own_gap(*pair) < 0]
        assert not inside, (name, [(parts[a][:2], parts[b][:2]) for a, b in inside])
        world.close()


def test_neighbours_never_meet() -> None:
    parts = {0: ["pelvis", "spine1", "spine2", "spine3", "neck", "head"], 1: ["left_shoulder"]}
    assert meeting_links(parts) == []
    parts |= {2: ["left_elbow"], 3: ["left_wrist"], 4: ["right_shoulder", "right_elbow"]}
    assert meeting_links(parts) == [(0, 2), (0, 3), (1, 4), (2, 4), (3, 4)]
