"""What CONTRIBUTING shows is complete, and runs."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[1] / "CONTRIBUTING.md"


@pytest.mark.slow
def test_the_task_shown_runs_in_a_house_and_its_script_succeeds(tmp_path: Path) -> None:
    page = PAGE.read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n((?:(?!```).)*register_task.*?)```", page, re.DOTALL)
    file = tmp_path / "reach_hand.py"
    file.write_text(code, encoding="utf-8")
    run = subprocess.run([sys.executable, str(file)], capture_output=True, text=True, check=True)
    distance, succeeded = run.stdout.split()[-2:]
    assert float(distance) < 0.18 and succeeded == "True"
