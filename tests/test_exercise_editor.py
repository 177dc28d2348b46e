"""Exercises that are written on the coach's page: what is shown of them, saved, and refused."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
import yaml

pytest.importorskip("aiohttp", reason="the coach's page needs the extra 'coach'")

from rcare_marl.agents.coaching.exercise import exercise_names, exercise_of, load_exercise
from rcare_marl.baselines.coaching.page.editor import drafted, fields_of
from rcare_marl.baselines.coaching.page.message import Draft, MessageError, parse
from rcare_marl.errors import RcareError

RAISE = fields_of(load_exercise("lateral_raise"))


def draft(name: str = "mine", **more: Any) -> Draft:
    message = parse(json.dumps({"type": "draft", "name": name, "exercise": RAISE, **more}))
    assert isinstance(message, Draft)
    return message


@pytest.mark.parametrize("name", exercise_names())
def test_what_is_saved_is_the_exercise_that_was_begun_with(name: str) -> None:
    shipped = load_exercise(name)
    saved = yaml.safe_load(drafted(draft(name, exercise=fields_of(shipped)))["yaml"])
    again = exercise_of(name, saved, "saved")
    assert np.array_equal(again.keys, shipped.keys)
    assert (again.duration, again.judged, again.say) == (
        shipped.duration,
        shipped.judged,
        shipped.say,
    )


def test_the_person_goes_no_further_than_they_get_and_the_coach_all_the_way() -> None:
    shown = drafted(draft(lift_left_deg=60, lift_right_deg=10))
    highest = {
        who: max(frame["left_wrist"][2] - frame["left_shoulder"][2] for frame in shown[who])
        for who in ("coach", "user")
    }
    assert highest["coach"] > -0.05 and highest["user"] < -0.2
    assert (shown["parts"], shown["left"]) == (["left arm", "right arm"], ["left arm"])
    assert len(shown["coach"]) == len(shown["user"]) == int(shown["duration"] * shown["rate"]) + 1


def test_what_is_no_exercise_is_refused_by_the_name_of_what_is_wrong() -> None:
    for change, said in (
        ({"poses": [{"angles_deg": {"shoulder_elevaton": 90}, "move_s": 1}]}, "shoulder_elevation"),
        ({"poses": [{"angles_deg": {}, "move_s": -1}]}, "move_s of a key pose must be positive"),
        ({"poses": []}, "nothing moves"),
        ({"return_s": None}, "mine.yaml.return_s"),
        ({"return_s": 1e6}, "here it may take 60 s"),
        ({"judged": {"range_share": 2}}, "range_share is a share"),
        ({"colour": "red"}, "colour"),
    ):
        with pytest.raises(RcareError, match=said):
            drafted(draft(exercise={**RAISE, **change}))
    for key, bad in (("name", "../mine"), ("name", "Mine"), ("exercise", []), ("turn_deg", 400)):
        with pytest.raises(MessageError):
            parse(json.dumps({"type": "draft", "name": "mine", "exercise": RAISE, key: bad}))
