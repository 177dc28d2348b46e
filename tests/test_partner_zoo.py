"""The partner zoo: people of several temperaments, who differ as they should."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from variants import few

import rcare_marl
from rcare_marl import assets
from rcare_marl.agents.people.avatar import load_avatar
from rcare_marl.agents.people.human import Human
from rcare_marl.baselines.evaluation.evaluate import evaluate
from rcare_marl.baselines.partners import (
    TEMPERAMENTS,
    Habits,
    Partner,
    Temperament,
    partner_zoo,
    trembling,
)
from rcare_marl.baselines.partners.zoo import MOODS, TemperamentFactory
from rcare_marl.baselines.policy_file import PolicyFile
from rcare_marl.envs import CareEnv
from rcare_marl.envs.learning import EnvRecipe
from rcare_marl.errors import ConfigError, UnknownNameError

PEOPLE = tuple(name for name in assets.names("avatars") if name != "caregiver")


def only(temperament: str, avatar: str = "karan") -> Partner:
    (found,) = partner_zoo("feeding", "recipient", avatars=[avatar], temperaments=[temperament])
    return found


def make(partner: Partner, robot: str = "still") -> CareEnv:
    return rcare_marl.make(
        partner.task, **partner.cast(), policies={"robot": robot, **partner.policies()}
    )


@pytest.fixture
def resisting() -> Iterator[CareEnv]:
    env = make(only("resisting"))
    yield env
    env.close()


def test_zoo_has_each_temperament_of_each_avatar_under_a_name_of_its_own() -> None:
    zoo = partner_zoo("feeding", "recipient", learned=())
    assert len({partner.name for partner in zoo}) == len(zoo) == len(PEOPLE) * len(TEMPERAMENTS)
    assert {p.model for p in zoo} == set(PEOPLE) and {p.temperament for p in zoo} == set(
        TEMPERAMENTS
    )


def test_individuals_come_beside_the_mood() -> None:
    zoo = partner_zoo(
        "feeding", "recipient", avatars=["kim"], temperaments=["resisting"], individuals=2
    )
    assert [p.policy for p in zoo] == ["resisting", "resisting_1", "resisting_2"]


def test_every_task_with_a_recipient_has_a_zoo() -> None:
    for task in rcare_marl.task_names():
        zoo = partner_zoo(task, "recipient", avatars=["daniel"], learned=())
        assert [p.temperament for p in zoo] == list(TEMPERAMENTS)
        for partner in zoo:
            EnvRecipe(task, cast=partner.cast(), partners=partner.policies())


def test_robots_have_a_zoo_of_their_controllers() -> None:
    zoo = partner_zoo("feeding", "robot", learned=())
    assert "scripted" in [partner.policy for partner in zoo]
    assert not {"random", "still", "behaviour"} & {partner.policy for partner in zoo}


@pytest.mark.parametrize(
    "temperament", few(["cooperative", "passive", "tremor"], "passive", "tremor")
)
def test_scripted_robot_feeds_whoever_lets_it(temperament: str) -> None:
    partner = only(temperament)
    found = evaluate("feeding", partner.policies(), episodes=1, cast=partner.cast())
    assert found.success_rate == 1.0


def test_resisting_person_turns_away_and_presses_the_lips_and_gives_in(resisting: CareEnv) -> None:
    resisting.reset(seed=1)
    person, policy = resisting.cast["recipient"], resisting.policies["recipient"]
    assert isinstance(person, Human) and isinstance(policy, Temperament)
    turned = {True: 0.0, False: 4.0}
    while not resisting.is_over:
        resists = policy.habits.resists_at(resisting.world.time)
        resisting.step({})
        turn = abs(person.angle("neck_rotation_left") + person.angle("head_rotation_left"))
        turned[resists] = max(turned[resists], turn) if resists else min(turned[resists], turn)
        if resists:
            assert person.angle("jaw_opening") < np.radians(10)
    assert turned[True] > 0.5 > 0.15 > turned[False]


def test_passive_person_does_not_follow_the_spoon_and_opens_late() -> None:
    openings = {}
    for temperament in ("cooperative", "passive"):
        env = make(only(temperament), robot="scripted")
        env.reset(seed=3)
        person, nearest, turn = env.cast["recipient"], 9.0, 0.0
        assert isinstance(person, Human)
        start = person.angle("neck_rotation_left")
        while not env.is_over:
            env.step({})
            turn = max(turn, abs(person.angle("neck_rotation_left") - start))
            if person.angle("jaw_opening") < np.radians(3):
                nearest = min(nearest, float(env.task.report()["distance_m"]))
        openings[temperament] = nearest, turn
        env.close()
    assert openings["passive"][0] < openings["cooperative"][0] - 0.02
    assert openings["passive"][1] < 0.02 < openings["cooperative"][1]


def test_trembling_person_is_the_avatar_but_for_the_shaking() -> None:
    before = load_avatar("kim")
    after = load_avatar(trembling("kim", ("neck_flexion", "jaw_opening"), 0.2))
    shaking = {"neck_flexors": 0.2, "neck_extensors": 0.2, "jaw": 0.2}
    assert after.profile.axial.tremor == {**before.profile.axial.tremor, **shaking}
    assert after.profile.left == before.profile.left
    assert (after.name, after.body, after.mass_kg) == (before.name, before.body, before.mass_kg)


def test_trembling_head_shakes_and_a_calm_one_does_not() -> None:
    shaken = {}
    for temperament in ("cooperative", "tremor"):
        env = make(only(temperament))
        env.reset(seed=0)
        person, places = env.cast["recipient"], []
        assert isinstance(person, Human)
        for step in range(20):
            env.step({})
            if step >= 12:
                places.append(person.mouth_position())
        shaken[temperament] = float(np.ptp(places, axis=0).max())
        env.close()
    assert shaken["cooperative"] < 0.001 < 0.003 < shaken["tremor"] < 0.03


@pytest.mark.parametrize("temperament", few(["resisting", "tremor"], "tremor"))
def test_same_seed_gives_the_same_episode(temperament: str) -> None:
    partner = only(temperament, "morgan")
    runs = []
    for _ in range(2):
        env = make(partner, robot="scripted")
        env.reset(seed=4)
        for _ in range(15):
            env.step({})
        runs.append(env.state())
        env.close()
    np.testing.assert_array_equal(runs[0], runs[1])


def test_a_mood_draws_its_habits_anew_and_an_individual_keeps_them(resisting: CareEnv) -> None:
    seen = {}
    for seed in (None, 2):
        policy = TemperamentFactory("resisting", seed)(resisting, "recipient")
        assert isinstance(policy, Temperament)
        habits: list[Habits] = []
        for episode in (0, 1):
            resisting.reset(seed=episode)
            policy.reset(np.random.default_rng(episode))
            habits.append(policy.habits)
        seen[seed] = habits
    assert seen[None][0] != seen[None][1] and seen[2][0] == seen[2][1]


def test_resistance_comes_in_spells() -> None:
    habits = Habits(opens_within=0.1, opening=0.5, first=2.0, spell=1.0, lull=3.0)
    resists = [habits.resists_at(0.5 + t) for t in range(10)]
    assert resists == [True, True, False, False, False, True, False, False, False, True]


def test_limbs_are_pulled_back_in_spells_and_slack_between() -> None:
    env = rcare_marl.make(
        "limb_repositioning", policies={"robot": "still", "recipient": "resisting"}
    )
    env.reset(seed=0)
    policy = env.policies["recipient"]
    assert isinstance(policy, Temperament)
    env.step({})
    person = env.cast["recipient"]
    assert isinstance(person, Human)
    policy.habits = Habits(0.1, 0.5, first=9.0, spell=1.0, lull=1.0)
    away = {
        dof: float(angle) + 0.3 for dof, angle in zip(person.movable, person.positions, strict=True)
    }
    person.set_angles(away)
    pulled = policy.act()
    policy.habits = Habits(0.1, 0.5, first=0.0, spell=1.0, lull=90.0)
    assert (pulled < 0).any() and not np.array_equal(pulled, policy.act())
    env.close()


@pytest.mark.parametrize("mood", MOODS)
def test_who_is_not_taken_by_a_limb_holds_the_head_up(mood: str) -> None:
    env = rcare_marl.make("scratching", policies={"robot": "still", "recipient": mood})
    env.reset(seed=0)
    person = env.cast["recipient"]
    assert isinstance(person, Human)
    before = person.mouth_position()
    for _ in range(50):
        env.step({})
    assert np.linalg.norm(person.mouth_position() - before) < 0.01
    env.close()


def test_a_robot_has_no_temperament() -> None:
    env = rcare_marl.make("feeding")
    with pytest.raises(ConfigError, match="is for people"):
        TemperamentFactory("passive")(env, "robot")
    env.close()


def test_partners_survive_pickling_and_name_no_path_in_records() -> None:
    partner = only("tremor")
    assert pickle.loads(pickle.dumps(partner)) == partner
    assert "/" not in str(partner.to_dict())


def learned(folder: Path, role: str = "recipient") -> Path:
    """Write a policy file of a recipient of feeding who knows nothing."""
    rng = np.random.default_rng(0)
    with_env = rcare_marl.make("feeding", recipient="kim", policies={"robot": "still"})
    parts = [(name, part.stop - part.start) for part, name, _ in with_env.describe("recipient")]
    size, actions = sum(n for _, n in parts), with_env.action_space("recipient").shape[0]
    with_env.close()
    file = PolicyFile(
        task="feeding",
        group=f"{role}s",
        roles=(role,),
        observed=tuple(parts),
        action_size=actions,
        action_low=-1.0,
        layers=(
            (rng.normal(size=(actions, size)).astype(np.float32), np.zeros(actions, np.float32)),
        ),
        mean=np.zeros(size, np.float32),
        scale=np.ones(size, np.float32),
        recipe={"task": "feeding", "cast": {"recipient": "kim"}},
    )
    file.save(folder / "kims_own.npz")
    return folder / "kims_own.npz"


def test_learned_partner_plays_in_the_body_that_it_was_trained_in(tmp_path: Path) -> None:
    file = learned(tmp_path)
    (partner,) = partner_zoo("feeding", "recipient", avatars=[], learned=[file])
    assert (partner.name, partner.model, partner.temperament) == ("kims_own", "kim", "learned")
    env = make(partner)
    assert env.cast["recipient"].describe()["avatar"] == "Kim"
    env.reset(seed=0)
    env.step({})
    env.close()


def test_policy_of_another_role_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="not 'robot' in 'feeding'"):
        partner_zoo("feeding", "robot", temperaments=[], learned=[learned(tmp_path)])


def test_unknown_names_are_refused_with_a_suggestion() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'tremor'"):
        partner_zoo("feeding", "recipient", temperaments=["tremors"])
    with pytest.raises(UnknownNameError, match="Did you mean 'karan'"):
        partner_zoo("feeding", "recipient", avatars=["karran"])
    with pytest.raises(UnknownNameError, match="Did you mean 'recipient'"):
        partner_zoo("feeding", "recipent")
    with pytest.raises(ConfigError, match="individuals"):
        partner_zoo("feeding", "recipient", individuals=9)
