"""People beside publications: what was fitted and what was held out are told apart."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

from typer.testing import CliRunner

from rcare_marl.agents.people.validation.body import checks
from rcare_marl.agents.people.validation.check import Check
from rcare_marl.agents.people.validation.people import Tally, as_rows, tallies
from rcare_marl.cli import app

ROW = Check("torque", "elbow", 50.0, 40.0, 60.0, "N·m", "somebody 1999", "read", is_fitted=True)


def test_fitted_held_out_and_memory_are_counted_apart() -> None:
    held = replace(ROW, is_fitted=False, ours=70.0)
    recalled = replace(ROW, basis="memory")
    assert tallies([ROW, held, replace(held, ours=40.0), recalled]) == [
        Tally("torque", "fitted", 1, 1),
        Tally("torque", "held out", 1, 2),
        Tally("torque", "memory", 1, 1),
    ]


def test_segment_masses_are_those_published_and_lengths_are_measured_on_the_bodies() -> None:
    found = checks()
    masses = [check for check in found if check.unit == "kg"]
    assert masses and all(check.is_in_band and check.is_fitted for check in masses)
    lengths = [check for check in found if check.unit == "cm"]
    assert len(lengths) == 7 * 6 and all(check.is_in_band for check in lengths)
    held_out = {check.case.rsplit(" ", 1)[1] for check in lengths if not check.is_fitted}
    assert held_out == {"trunk"}


def test_the_command_leaves_rows_and_a_page_and_names_the_nearest_family(tmp_path: Path) -> None:
    record, page = tmp_path / "rows.json", tmp_path / "page.md"
    args = ["validate", "people", "--family", "body", "--output", str(record), "--page", str(page)]
    result = CliRunner().invoke(app, args)
    assert result.exit_code == 0 and "held out" in result.output
    rows = json.loads(record.read_text(encoding="utf-8"))
    assert len(rows) == len(checks()) and {"split", "in_band", "source"} <= rows[0].keys()
    assert "de Leva 1996" in page.read_text(encoding="utf-8")
    assert json.loads(CliRunner().invoke(app, [*args[:4], "--json"]).output) == rows
    wrong = CliRunner().invoke(app, ["validate", "people", "--family", "bodi"])
    assert wrong.exit_code == 2 and "body" in wrong.output


def test_a_band_without_an_end_is_null_in_json() -> None:
    assert as_rows([replace(ROW, high=math.inf)])[0]["high"] is None
