"""The trees of the avatars: they run, can be drawn, follow ability, and play a role in a task."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from behaving_person import Scene
from PIL import Image
from variants import few

import rcare_marl
from rcare_marl import assets
from rcare_marl.agents.people.behaviour.avatar_tree import (
    AvatarBehaviour,
    BehaviourConfig,
    Surroundings,
    behaviour_of,
)
from rcare_marl.agents.people.behaviour.cue import GESTURES
from rcare_marl.agents.people.behaviour.tree_picture import TreePicture
from rcare_marl.agents.people.human import Human
from rcare_marl.config import load
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.tasks.feeding import Feeding
from rcare_marl.errors import ConfigError, UnknownNameError

AVATARS = assets.names("avatars")
Array = npt.NDArray[np.float64]


# The avatars.


@pytest.mark.parametrize("avatar", few(AVATARS, "kim"))
def test_the_tree_of_every_avatar_runs_and_can_be_drawn(avatar: str, tmp_path: Path) -> None:
    scene = Scene(avatar, config=behaviour_of(Scene(avatar, movable=("head",)).person))
    for text in sorted(GESTURES):
        scene.cues.instruction.say(text)
        scene.run(0.3)
    scene.run(2)
    assert np.isfinite(scene.person.positions).all()
    picture = TreePicture(scene.policy.root, subtitle=scene.policy.config.description)
    nodes = list(scene.policy.root.iterate())
    assert len(picture.boxes) == len(nodes) <= 60
    image = Image.open(picture.save(tmp_path / "tree.png"))
    assert len(set(image.resize((300, 300)).getdata())) > 20  # something is drawn
    svg = picture.save(tmp_path / "tree.svg").read_text()
    text_form = picture.save(tmp_path / "tree.txt").read_text()
    for node in nodes:
        assert node.name in svg and node.name in text_form
    with pytest.raises(ConfigError, match=r"\.png, \.svg or \.txt"):
        picture.save(tmp_path / "tree.gif")


def overlaps(picture: TreePicture) -> int:
    boxes = picture.boxes
    return sum(
        a.x < b.x + b.width and b.x < a.x + a.width and abs(a.y - b.y) < 30
        for i, a in enumerate(boxes)
        for b in boxes[i + 1 :]
    )


def test_boxes_of_a_picture_do_not_overlap_and_lie_inside() -> None:
    picture = TreePicture(Scene("karan").policy.root)
    assert overlaps(picture) == 0
    width, height = picture.size
    for box in picture.boxes:
        assert 0 <= box.x and box.x + box.width <= width and 15 <= box.y <= height - 15


def test_trees_follow_the_ability_of_their_people() -> None:
    possible = {avatar: Scene(avatar).cues.instruction.possible for avatar in AVATARS}
    arms = {text for text in GESTURES if "arm" in text or "elbow" in text}
    assert not arms & possible["jose"]
    assert {"raise your right arm", "bend your right elbow"} <= possible["natalia"]
    assert "straighten your right elbow" not in possible["natalia"]
    assert "straighten your right elbow" in possible["daniel"]
    assert "lean forward" in possible["karan"] and "lean forward" not in possible["daniel"]
    for avatar in AVATARS:
        assert {"hold still", "look at me", "turn your head left"} <= possible[avatar]


def test_who_can_move_nothing_in_a_scene_is_still() -> None:
    scene = Scene("jose", movable=("left_elbow_flexion",)).run(0.5)
    assert "be still" in scene.running()
    assert not np.any(scene.policy.act())


def test_a_job_is_done_until_something_stronger_interrupts() -> None:
    class Job:
        calls = 0

        def reset(self, rng: np.random.Generator) -> None:
            self.calls = 0

        def act(self) -> Array:
            self.calls += 1
            return np.zeros(scene.person.action_size)

    scene = Scene()
    around = Surroundings(lambda: scene.world.time, job=(job := Job()))
    scene.policy = AvatarBehaviour(scene.person, around, 0.1)
    scene.cues = scene.policy.cues
    scene.run(0.5)
    assert job.calls == 5
    scene.cues.refuses = True
    scene.run(0.5)
    assert job.calls == 5


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"tired_from": 0.2}, "rested_below <= tired_from"),
        ({"activities": []}, "must name one at least"),
        ({"reactions": ["cough", "cough"]}, "twice"),
        ({"opening": 0.0}, "opening must lie in"),
        ({"flinches_from": 11.0}, "flinches_from must lie in"),
        ({"opens_within": -1.0}, "opens_within must lie in"),
        ({"reactions": ["sneeze"]}, "sneeze"),
    ],
)
def test_a_bad_behaviour_is_refused(values: dict[str, object], message: str) -> None:
    with pytest.raises((ConfigError, UnknownNameError), match=message):
        load(BehaviourConfig, {"description": "x", **values})


# In an environment.


def play(env: CareEnv, seed: int) -> list[float]:
    env.reset(seed=seed)
    out: list[float] = []
    while not env.is_over:
        env.step({})
        out += env.observe("recipient").tolist()
    assert isinstance(env.cast["recipient"], Human)
    return out + list(env.cast["recipient"].physiology.values().values())


def test_an_episode_with_a_behaving_person_is_a_function_of_the_seed() -> None:
    policies = {"robot": "scripted", "recipient": "behaviour"}
    env = rcare_marl.make("feeding", policies=policies)
    first, _, again = play(env, 3), play(env, 4), play(env, 3)
    env.close()
    fresh = rcare_marl.make("feeding", policies=policies)
    assert first == again == play(fresh, 3)
    fresh.close()


@pytest.mark.parametrize("avatar", few(("jose", "morgan", "kim", "caregiver"), "jose", "kim"))
def test_a_behaving_person_can_be_fed(avatar: str) -> None:
    env = rcare_marl.make(
        "feeding", recipient=avatar, policies={"robot": "scripted", "recipient": "behaviour"}
    )
    play(env, 0)
    assert isinstance(env.task, Feeding) and env.task.succeeded()
    env.close()


def test_a_refusing_person_is_not_fed() -> None:
    env = rcare_marl.make("feeding", policies={"robot": "scripted", "recipient": "behaviour"})
    env.reset(seed=0)
    policy = env.policies["recipient"]
    assert isinstance(policy, AvatarBehaviour)
    policy.cues.refuses = True
    while not env.is_over:
        env.step({})
    assert env.task.report()["eaten_pieces"] == 0
    env.close()


def test_a_robot_has_no_behaviour_of_people() -> None:
    with pytest.raises(UnknownNameError, match="no policy of 'robot' in task 'feeding'"):
        rcare_marl.make("feeding", policies={"robot": "behaviour"})


def test_a_caregiver_watches_the_person_and_not_the_spoon() -> None:
    env = rcare_marl.make(
        "feeding",
        caregiver={"model": "caregiver", "movable": ["neck", "head"]},
        policies={"robot": "still", "recipient": "still", "caregiver": "behaviour"},
    )
    env.reset(seed=0)
    caregiver, recipient = env.cast["caregiver"], env.cast["recipient"]
    assert isinstance(caregiver, Human) and isinstance(recipient, Human)
    for _ in range(25):
        env.step({})
    way = recipient.mouth_position() - caregiver.mouth_position()
    angle = math.acos(float(caregiver.face_direction() @ way / np.linalg.norm(way)))
    assert angle < 0.35
    env.close()
