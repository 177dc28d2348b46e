"""Cross-play: each policy with each partner, and what the matrix says."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from rcare_marl.baselines.evaluation.cross_play import CrossPlay, cross_play
from rcare_marl.baselines.evaluation.evaluate import evaluate, wilson_interval
from rcare_marl.baselines.partners import Partner, partner_zoo
from rcare_marl.errors import ConfigError, UnknownNameError

ROBOTS = {"scripted": "scripted", "idle": "still"}


def zoo() -> list[Partner]:
    moods = ["cooperative", "resisting"]
    return list(partner_zoo("feeding", "recipient", avatars=["karan"], temperaments=moods))


@pytest.fixture(scope="module")
def played() -> CrossPlay:
    own = {"scripted": ["karan_cooperative"]}
    return cross_play("feeding", ROBOTS, zoo(), episodes=1, seed=5, own=own)


def made(success: list[list[float]], own: Mapping[str, tuple[str, ...]]) -> CrossPlay:
    """Return a matrix of given success, one episode a pair."""
    array = np.array(success)[..., None]
    rows, columns = array.shape[:2]
    values = {m: array for m in ("success", "return", "peak_force", "cost", "steps")}
    robots = tuple(f"robot_{i}" for i in range(rows))
    return CrossPlay(
        "feeding", "recipient", robots, tuple(f"partner_{j}" for j in range(columns)), values, own
    )


@pytest.mark.slow
def test_cells_are_what_each_pair_does_alone(played: CrossPlay) -> None:
    assert played.policies == ("scripted", "idle")
    for j, partner in enumerate(zoo()):
        alone = evaluate(
            "feeding",
            {"robot": "scripted", **partner.policies()},
            episodes=1,
            seed=5,
            cast=partner.cast(),
        )
        assert played.success[0, j] == alone.success_rate
        returns = [episode.returns["robot"] for episode in alone.episodes]
        np.testing.assert_array_equal(played.values["return"][0, j], returns)
        assert played.matrix("peak_force")[0, j] == alone.peak_force
        assert played.matrix("steps")[0, j] == np.mean([e.steps for e in alone.episodes])
    assert played.success[1].max() == 0.0  # who does not move feeds nobody


@pytest.mark.slow
def test_processes_change_nothing(played: CrossPlay) -> None:
    own = {"scripted": ["karan_cooperative"]}
    again = cross_play("feeding", ROBOTS, zoo(), episodes=1, seed=5, own=own, processes=2)
    assert again.to_dict() == played.to_dict()


def test_record_comes_back_as_it_was(played: CrossPlay, tmp_path: Path) -> None:
    played.save(tmp_path / "matrix.json")
    back = CrossPlay.read(tmp_path / "matrix.json")
    assert back.to_dict() == played.to_dict()
    assert back.own == {"scripted": ("karan_cooperative",)}


def test_measure_that_a_task_does_not_report_stays_unknown(tmp_path: Path) -> None:
    found = made([[1.0]], {})
    unknown = dataclasses.replace(
        found, values={**found.values, "cost": np.full((1, 1, 1), np.nan)}
    )
    unknown.save(tmp_path / "matrix.json")
    back = CrossPlay.read(tmp_path / "matrix.json")
    assert np.isnan(back.matrix("cost")).all() and "–" in back.table("cost")


def test_gap_compares_known_partners_with_the_others() -> None:
    own = {"robot_0": ("partner_0",), "robot_1": ("partner_1",)}
    gap = made([[1.0, 0.2], [0.4, 0.8]], own).gap()
    assert gap.own == pytest.approx(0.9) and gap.others == pytest.approx(0.3)
    assert np.isnan(made([[1.0]], {}).gap().own)


def test_part_of_a_matrix_keeps_its_numbers_and_owners() -> None:
    own = {"robot_0": ("partner_0",), "robot_1": ("partner_1", "partner_2")}
    part = made([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]], own).select(
        ["robot_1"], ["partner_2", "partner_0"]
    )
    assert part.success.tolist() == [[0.6, 0.4]]
    assert part.own == {"robot_1": ("partner_2",)}


def test_interval_counts_all_episodes_of_the_chosen_partners() -> None:
    found = made([[1.0, 0.0, 1.0]], {})
    assert found.interval("robot_0") == wilson_interval(2, 3)
    assert found.interval("robot_0", ["partner_1"]) == wilson_interval(0, 1)


def test_table_has_every_cell_and_marks_known_partners() -> None:
    lines = made([[1.0, 0.25]], {"robot_0": ("partner_0",)}).table().splitlines()
    assert lines[2] == "| robot_0 | **100** | 25 | 62 |"


def test_picture_shows_each_pair_in_the_colour_of_its_number(tmp_path: Path) -> None:
    found = made([[1.0, 0.0], [0.0, 1.0]], {"robot_0": ("partner_0",)})
    found.draw(tmp_path / "matrix.png")
    picture = imread(tmp_path / "matrix.png")[..., :3]
    flat = np.round(picture.reshape(-1, 3), 2)
    colours, counts = np.unique(flat, axis=0, return_counts=True)
    largest = colours[np.argsort(counts)[-3:]]  # white, and the two of the cells
    assert len({tuple(c) for c in largest.tolist()}) == 3
    orange = np.abs(flat - np.array([0xD5, 0x5E, 0x00]) / 255).max(axis=1) < 0.02
    assert orange.sum() > 100  # the frame of the pair that trained together


def test_picture_of_many_partners_can_stand_upright(tmp_path: Path) -> None:
    found = made([[1.0] * 12], {})
    for down in (False, True):
        found.draw(tmp_path / f"{down}.png", partners_down=down)
    lying, standing = (imread(tmp_path / f"{down}.png").shape for down in (False, True))
    assert lying[1] > 2 * lying[0] and standing[0] > standing[1]


def test_bad_matches_are_refused() -> None:
    one = zoo()[0]
    with pytest.raises(ConfigError, match="at least"):
        cross_play("feeding", {}, [one])
    with pytest.raises(ConfigError, match="names of their own"):
        cross_play("feeding", ROBOTS, [one, one])
    with pytest.raises(ConfigError, match="not in question"):
        cross_play("feeding", ROBOTS, [dataclasses.replace(one, role="robot")])
    with pytest.raises(ConfigError, match="processes"):
        cross_play("feeding", ROBOTS, [one], processes=0)
    with pytest.raises(UnknownNameError, match="policy in the matrix"):
        made([[1.0]], {"robot_9": ("partner_0",)})
    with pytest.raises(UnknownNameError, match="measure"):
        made([[1.0]], {}).matrix("sucess")


def test_damaged_record_is_refused(tmp_path: Path) -> None:
    (tmp_path / "matrix.json").write_text('{"task": "feeding"}')
    with pytest.raises(ConfigError, match="no record of a cross-play"):
        CrossPlay.read(tmp_path / "matrix.json")
