"""Behaviour: each sub-tree does what it says in simulation, and what is stronger interrupts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import product

import numpy as np
import numpy.typing as npt
import pytest
from behaving_person import CLOSED, DRIVEN, OPEN, UPPER, Kind, Scene
from variants import few

from rcare_marl.agents.people.actuation.muscular import MuscleDrive
from rcare_marl.agents.people.behaviour.avatar_tree import load_behaviour
from rcare_marl.agents.people.behaviour.cue import GESTURES
from rcare_marl.agents.people.behaviour.leaves import Actor, Settle, Threshold
from rcare_marl.errors import ConfigError, UnknownNameError

Array = npt.NDArray[np.float64]


# Muscles are slow where a skeletal drive shows the same; others of these tests run both.
MUSCLES_SLOW = pytest.mark.parametrize("kind", few(("skeletal", "muscle"), "skeletal"))


def is_slack(scene: Scene) -> bool:
    """Return whether somebody wishes nothing: muscles slacken, targets stay where they are."""
    drive = scene.person.drive
    if isinstance(drive, MuscleDrive):
        return bool(drive.excitation.mean() < 0.02)
    return not scene.policy.act().any()


@DRIVEN
def test_the_mouth_opens_for_a_near_spoon_and_closes_when_it_leaves(kind: Kind) -> None:
    gap = [0.5]
    scene = Scene(kind=kind, spoon=lambda: scene_mouth() + (gap[0], 0, 0))

    def scene_mouth() -> Array:
        return scene.person.mouth_position()

    assert scene.run(1).angle("jaw_opening") < CLOSED[kind]
    gap[0] = 0.15
    assert scene.run(2).angle("jaw_opening") > OPEN[kind]
    gap[0] = 0.5
    assert scene.run(2).angle("jaw_opening") < CLOSED[kind]


def test_a_spoon_at_the_limit_does_not_make_the_mouth_flutter() -> None:
    gap = [0.19]
    scene = Scene(spoon=lambda: scene.person.mouth_position() + (gap[0], 0, 0))
    scene.run(1)
    for gap[0] in (0.21, 0.19, 0.21):
        assert scene.run(0.5).angle("jaw_opening") > 0.3
    gap[0] = 0.24
    assert scene.run(1).angle("jaw_opening") < 0.05


@DRIVEN
def test_the_head_follows_a_point_while_the_mouth_opens(kind: Kind) -> None:
    side = [0.08]
    scene = Scene(kind=kind, spoon=lambda: scene.person.mouth_position() + (0.15, side[0], 0.0))
    scene.run(2)
    assert scene.person.face_direction()[1] > 0.1
    assert scene.angle("jaw_opening") > OPEN[kind]
    side[0] = -0.08
    scene.run(2)
    assert scene.person.face_direction()[1] < -0.1 and scene.angle("jaw_opening") > OPEN[kind]


def test_eyes_look_where_the_head_cannot() -> None:
    start = Scene().person.mouth_position()
    eyes = (
        "left_eye_smplhf",
        "right_eye_smplhf",
        "neck_lateral_flexion_left",
        "jaw_opening",
        "head_rotation_left",
    )
    scene = Scene("jose", movable=eyes, spoon=lambda: start + (0.5, 0.5, 0.0)).run(3)
    assert scene.angle("left_eye_abduction") > 0.2  # both to the left
    assert scene.angle("right_eye_abduction") < -0.2


def test_locked_in_eyes_look_up_and_down_but_not_to_the_side() -> None:
    start = Scene("morgan").person.mouth_position()
    eyes = ("left_eye_smplhf", "right_eye_smplhf", "head_rotation_left", "jaw_opening")
    scene = Scene("morgan", movable=eyes, spoon=lambda: start + (0.5, 0.5, 0.4)).run(3)
    for side in ("left", "right"):
        assert scene.angle(f"{side}_eye_elevation") > 0.2
        assert abs(scene.angle(f"{side}_eye_abduction")) < 0.02


NEVER = {  # what a condition rules out
    "morgan": ("raise", "bend", "straighten", "lift your left", "lower", "lean", "sit"),
    "jose": ("raise", "bend", "straighten", "lift your left", "lower", "lean", "sit"),
    "natalia": ("straighten", "lift your left", "lean", "sit"),
    "daniel": ("lift your left", "lean", "sit"),
}


@pytest.mark.parametrize("avatar", NEVER)
def test_what_no_muscle_can_do_is_answered_cannot_at_once(avatar: str) -> None:
    instruction = Scene(avatar, movable=(*UPPER, "left_hip", "left_knee")).cues.instruction
    for text in GESTURES:
        instruction.say(text, speaker=lambda: np.array((0.8, -0.8, 1.2)))
        if text.startswith(NEVER[avatar]):
            assert instruction.answer == "cannot", text
    for text in ("open your mouth", "look at me", "hold still"):
        instruction.say(text, speaker=lambda: np.array((0.8, -0.8, 1.2)))
        assert instruction.answer == "trying", text


def test_done_is_said_of_the_way_gone_not_of_being_near() -> None:
    scene = Scene("kim")  # her head is turned to the right already, and her trunk is stiff
    scene.cues.instruction.say("turn your head right")
    rest = scene.angle("neck_rotation_left")
    while scene.answer() == "trying":
        scene.run(0.1)
    assert scene.answer() == "done"
    assert scene.angle("neck_rotation_left") < 0.5 * (rest + math.radians(-22))
    scene.cues.instruction.say("lean forward")
    assert scene.run(6.3).answer() == "cannot"


def follow_and_check(text: str, dof: str, least: float, kind: Kind) -> None:
    scene = Scene(kind=kind)
    assert scene.answer() == "nothing asked"
    scene.run(0.5)
    scene.cues.instruction.say(text)
    assert scene.answer() == "trying"
    scene.run(4)
    assert scene.angle(dof) > least and scene.answer() == "done"
    scene.cues.instruction.clear()
    scene.run(4)
    assert scene.angle(dof) < 0.7 * max(least, 1.5)


@pytest.mark.parametrize(
    ("text", "dof", "least", "kind"),
    [
        pytest.param(*asked, kind, marks=pytest.mark.slow if kind == "muscle" and i else ())
        for i, asked in enumerate(
            [
                ("raise your right arm", "right_shoulder_flexion", 0.9),
                ("bend your left elbow", "left_elbow_flexion", 1.8),
                ("turn your head left", "neck_rotation_left", 0.3),
                ("open your mouth", "jaw_opening", 0.2),
                ("lean forward", "spine1_flexion", 0.1),
            ]
        )
        for kind in ("skeletal", "muscle")
    ],
)
def test_a_sentence_is_followed_and_answered(text: str, dof: str, least: float, kind: Kind) -> None:
    follow_and_check(text, dof, least, kind)


@MUSCLES_SLOW
def test_who_tries_in_vain_says_so_after_a_while_and_gives_up(kind: Kind) -> None:
    scene = Scene("karan", kind=kind)  # his left arm is too weak
    rest = scene.angle("left_shoulder_flexion")
    scene.cues.instruction.say("raise your left arm")
    assert scene.run(5.8).answer() == "trying"
    scene.cues.instruction.say("raise your left arm")  # said once more: tries once more
    assert scene.run(5.8).answer() == "trying"
    assert scene.run(0.5).answer() == "cannot"
    assert scene.run(3).angle("left_shoulder_flexion") == pytest.approx(rest, abs=0.15)
    scene.cues.instruction.say("raise your right arm")
    assert scene.run(4).answer() == "done"
    assert scene.run(8).answer() == "done"  # and done stays done


@MUSCLES_SLOW
@pytest.mark.slow
def test_no_sentence_is_tried_for_ever(kind: Kind) -> None:
    scene = Scene("kim", kind=kind)
    for text in sorted(scene.cues.instruction.possible):
        scene.cues.instruction.say(text, speaker=lambda: np.array((0.8, -0.8, 1.2)))
        scene.person.physiology.fatigue = (
            0.0  # weak limbs tire, and the tired rest before they answer
        )
        assert scene.run(6.2).answer() in ("done", "cannot")


@DRIVEN
def test_look_at_me_turns_to_the_speaker(kind: Kind) -> None:
    scene = Scene(kind=kind)
    scene.cues.instruction.say("look at me")
    assert scene.answer() == "cannot"  # nobody knows where the speaker is
    scene.cues.instruction.say("look at me", speaker=lambda: np.array((0.8, -0.8, 1.2)))
    assert scene.run(3).person.face_direction()[1] < -0.4
    assert scene.answer() == "done"


@DRIVEN
def test_who_cannot_says_so_and_does_nothing(kind: Kind) -> None:
    scene = Scene("jose", kind=kind)
    scene.cues.instruction.say("raise your right arm")
    assert scene.answer() == "cannot"
    before = scene.angle("right_shoulder_flexion")
    assert scene.run(2).angle("right_shoulder_flexion") == pytest.approx(before, abs=0.02)
    with pytest.raises(UnknownNameError, match="Did you mean 'hold still'"):
        scene.cues.instruction.say("holt still")


@DRIVEN
def test_holding_still_stops_a_movement_on_its_way(kind: Kind) -> None:
    scene = Scene(kind=kind)
    scene.cues.instruction.say("raise your right arm")
    scene.run(1.0)
    scene.cues.instruction.say("hold still")
    scene.run(0.5)
    there = scene.angle("right_shoulder_flexion")
    assert scene.run(2).angle("right_shoulder_flexion") == pytest.approx(there, abs=0.06)
    assert 0.4 < there < 1.2 and scene.answer() == "done"


@DRIVEN
def test_who_relaxes_wishes_nothing(kind: Kind) -> None:
    scene = Scene(kind=kind)
    scene.run(1)
    scene.cues.instruction.say("relax")
    scene.run(4)  # what hung on muscles swings before it rests
    assert is_slack(scene) and scene.answer() == "done"


@MUSCLES_SLOW
def test_a_reach_goes_for_the_angles_that_it_is_given(kind: Kind) -> None:
    scene = Scene(kind=kind)
    wish: Mapping[str, float] = {"right_shoulder_flexion": 0.9, "right_elbow_flexion": 0.6}
    scene.cues.reach = lambda: wish
    scene.run(3)
    for dof, angle in wish.items():
        assert scene.angle(dof) == pytest.approx(angle, abs=0.06)
    scene.cues.reach = None
    assert scene.run(3).angle("right_shoulder_flexion") < 0.5
    with pytest.raises(ConfigError, match="a function that returns angles"):
        scene.cues.reach = wish  # type: ignore[assignment]


@MUSCLES_SLOW
def test_pain_withdraws_the_limb_that_hurts_and_no_other(kind: Kind) -> None:
    scene = Scene(kind=kind)
    scene.run(0.5)
    before = {dof: scene.angle(dof) for dof in ("left_elbow_flexion", "right_elbow_flexion")}
    scene.person._meter._forces = lambda: {"left_wrist": 250.0}  # type: ignore[method-assign]
    scene.run(1.5)
    assert scene.person.physiology.pain_segment == "left_wrist"
    assert "flinch" in scene.running()
    assert scene.angle("left_elbow_flexion") > before["left_elbow_flexion"] + 0.3
    assert scene.angle("right_elbow_flexion") == pytest.approx(
        before["right_elbow_flexion"], abs=0.05
    )
    del scene.person._meter._forces
    scene.run(20)
    assert "flinch" not in scene.running()
    assert scene.angle("left_elbow_flexion") == pytest.approx(before["left_elbow_flexion"], abs=0.1)


@DRIVEN
def test_pain_without_a_place_makes_them_brace(kind: Kind) -> None:
    scene = Scene("jose", kind=kind)
    before = scene.angle("neck_flexion")
    scene.person.physiology.hold({"pain": 8})
    scene.run(1)
    assert "flinch" in scene.running() and scene.angle("neck_flexion") > before + 0.05


@DRIVEN
def test_who_refuses_turns_away_from_the_spoon_and_closes_the_mouth(kind: Kind) -> None:
    scene = Scene(kind=kind, spoon=lambda: scene.person.mouth_position() + (0.15, 0.03, 0.0))
    scene.run(2)
    assert scene.angle("jaw_opening") > OPEN[kind]
    scene.cues.refuses = True
    scene.run(2)
    assert scene.angle("jaw_opening") < CLOSED[kind]
    assert scene.person.face_direction()[1] < -0.4  # the spoon is on the left
    scene.cues.refuses = False
    assert scene.run(2).angle("jaw_opening") > OPEN[kind]


@DRIVEN
def test_a_cough_bends_the_neck_three_times_and_is_over(kind: Kind) -> None:
    scene, seen = Scene(kind=kind), list[float]()
    scene.run(0.5)
    rest = scene.angle("neck_flexion")
    scene.cues.must_cough = True
    scene.run(3.5, lambda: seen.append(scene.angle("neck_flexion") - rest))
    up = np.array(seen) > 0.08
    assert (np.diff(up.astype(int)) == 1).sum() == 3
    assert not scene.cues.must_cough and abs(seen[-1]) < 0.03


@MUSCLES_SLOW
def test_the_tired_rest_until_they_have_recovered(kind: Kind) -> None:
    scene = Scene(kind=kind)
    scene.cues.instruction.say("raise your right arm")
    scene.run(3)
    scene.person.physiology.fatigue = 0.65
    scene.run(3)
    assert "rest" in scene.running() and scene.angle("right_shoulder_flexion") < 0.5
    scene.person.physiology.fatigue = 0.45  # between the thresholds: still resting
    scene.run(1)
    assert "rest" in scene.running()
    scene.person.physiology.fatigue = 0.2
    scene.run(3)
    assert "rest" not in scene.running() and scene.angle("right_shoulder_flexion") > 0.9


QUICK_TIRED = {("caregiver", 0.65, "muscle"), ("karan", 0.95, "skeletal")}


@pytest.mark.parametrize(
    ("avatar", "fatigue", "kind"),
    [
        pytest.param(*case, marks=() if case in QUICK_TIRED else pytest.mark.slow)
        for case in product(("caregiver", "karan"), (0.65, 0.95), ("skeletal", "muscle"))
    ],
)
def test_the_tired_let_go_and_stay_so(avatar: str, fatigue: float, kind: Kind) -> None:
    scene = Scene(avatar, movable=None, kind=kind, config=load_behaviour("anybody"))
    scene.cues.instruction.say("raise your right arm")
    scene.run(2)
    scene.person.physiology.fatigue = fatigue
    tips: list[str] = []
    slack: list[bool] = []
    speeds: list[float] = []

    def note() -> None:
        tip = scene.policy.root.tip()
        tips.append(tip.name if tip is not None else "")
        slack.append(is_slack(scene))
        speeds.append(float(np.abs(scene.person.velocities).max()))

    scene.run(0.1, note)
    assert tips == ["go back to rest"]
    scene.run(5)  # what hung on muscles swings before it rests
    tips, slack, speeds = [], [], []
    scene.run(3, note)
    assert set(tips) == {"let go"} and all(slack)
    assert kind == "skeletal" or max(speeds) < 0.6  # no muscle jolts what rests


def test_who_settles_judges_some_joints_only_and_has_patience() -> None:
    now, person = [5.0], Scene().person
    actor = Actor(person, clock=lambda: now[0])
    wish = {"right_elbow_flexion": person.angle("right_elbow_flexion") + 1.0, "neck_flexion": 0.1}

    def leaf(judged: str) -> Settle:
        return Settle("settle", actor, lambda: wish, patience=3.0, judged=[judged])

    stuck = leaf("right_elbow_flexion")
    for now[0], status in ((5.0, "RUNNING"), (7.9, "RUNNING"), (8.0, "SUCCESS")):
        stuck.tick_once()
        assert stuck.status.name == status
    near = leaf("neck_flexion")
    near.tick_once()
    assert near.status.name == "SUCCESS"


def test_a_cough_does_not_make_the_tired_forget_that_they_rest() -> None:
    scene = Scene()
    scene.person.physiology.fatigue = 0.65
    scene.run(0.5)
    scene.person.physiology.fatigue = 0.45
    scene.cues.must_cough = True
    assert scene.run(0.5).running() == {"cough"}
    scene.run(3)
    assert scene.running() == {"rest"}


def test_an_episode_of_one_step_leaves_nobody_tired() -> None:
    scene = Scene()
    scene.person.physiology.fatigue = 0.9
    scene.policy.act()
    assert scene.running() == {"rest"}
    scene.policy.reset(np.random.default_rng(0))  # at the very time of the last tick
    scene.person.physiology.fatigue = 0.45
    scene.policy.act()
    assert scene.running() == {"engage"}


def test_a_misspelt_cue_is_named() -> None:
    cues = Scene().cues
    for wrong, right in (("must_cuogh", "must_cough"), ("refuse", "refuses"), ("reech", "reach")):
        with pytest.raises(UnknownNameError, match=f"Did you mean '{right}'"):
            setattr(cues, wrong, True)


# Composition.


@MUSCLES_SLOW
def test_cough_and_pain_interrupt_anything(kind: Kind) -> None:
    scene = Scene(kind=kind)
    for begin in ("hold still", "relax", "raise your right arm", "open your mouth"):
        scene.cues.instruction.say(begin)
        scene.cues.refuses = True
        scene.person.physiology.set({"fatigue": 0.9})
        scene.run(0.3)
        scene.person.physiology.hold({"pain": 9})
        scene.run(0.1)
        assert scene.running() == {"flinch"}
        scene.cues.must_cough = True
        scene.run(0.1)
        assert scene.running() == {"cough"}
        scene.run(3)
        assert scene.running() == {"flinch"}
        scene.person.physiology.release()
        scene.person.physiology.set({"pain": 0, "fatigue": 0})
        scene.cues.refuses = False
        scene.run(0.1)


def test_two_trees_in_one_process_share_nothing() -> None:
    one, other = Scene(), Scene()
    one.cues.instruction.say("raise your right arm")
    one.cues.must_cough = True
    other.run(2)
    assert other.running() == {"engage"} and not other.cues.must_cough
    one.run(6)
    assert one.angle("right_shoulder_flexion") > 0.9
    assert other.run(4).angle("right_shoulder_flexion") < 0.5


def test_an_episode_forgets_what_was_asked_in_the_last() -> None:
    scene = Scene()
    scene.cues.instruction.say("raise your right arm")
    scene.cues.refuses = True
    scene.policy.reset(np.random.default_rng(0))
    assert scene.cues.instruction.text is None and not scene.cues.refuses


def test_a_threshold_begins_high_ends_low_and_forgets_at_a_new_episode() -> None:
    value, now = [0.0], [0.0]
    leaf = Threshold("x", lambda: value[0], lambda: now[0], begins=0.6, ends=0.3)
    seen = []
    for value[0] in (0.5, 0.7, 0.5, 0.29, 0.5):
        now[0] += 0.1
        leaf.tick_once()
        seen.append(leaf.status.name == "SUCCESS")
    assert seen == [False, True, True, False, False]
    for value[0], now[0] in ((0.7, 1.0), (0.5, 0.1)):
        leaf.tick_once()
    assert leaf.status.name == "FAILURE"
    with pytest.raises(ConfigError, match="above"):
        Threshold("x", lambda: 0.0, lambda: 0.0, begins=0.1, ends=0.2)
