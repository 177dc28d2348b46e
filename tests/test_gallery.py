"""The gallery: a named picture of everybody, or an error that says who there is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from rcare_marl.cli import gallery
from rcare_marl.errors import ConfigError, UnknownNameError


@pytest.mark.slow
def test_a_picture_of_each_and_a_sheet_of_those_of_a_kind(tmp_path: Path) -> None:
    files = gallery.make(tmp_path, ("robots", "avatars"), ("nao", "ur5", "karan"))
    names = {file.relative_to(tmp_path).as_posix() for file in files}
    assert names == {"robots/nao.png", "robots/ur5.png", "avatars/karan.png", "robots.jpg"}
    for file in files:
        with Image.open(file) as picture:
            pixels = np.asarray(picture.convert("RGB"), np.float64)
        assert pixels.std() > 10, file  # something is drawn
    one = np.asarray(Image.open(tmp_path / "robots" / "nao.png").convert("RGB"))
    caption = one[gallery.SIZE[1] :]
    assert (caption < 120).any()  # with a name below


def test_subjects_fill_the_picture_and_none_is_cut_off() -> None:
    for plate in (gallery.robot_plate("nao"), gallery.avatar_plate("karan")):
        drawn = plate.picture.astype(np.float64)
        edges = np.abs(np.diff(drawn, axis=0)).sum(axis=2) > 60
        rows, columns = np.nonzero(edges)
        assert np.ptp(rows) > 0.5 * gallery.SIZE[1] or np.ptp(columns) > 0.5 * gallery.SIZE[0]


def test_unknown_names_and_kinds_say_what_there_is(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'nao'"):
        gallery.make(tmp_path, ("robots",), ("naao",))
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(ConfigError, match="robots, avatars, all"):
        gallery.check_kind("people")
