"""Write the records of baselines/leaderboard/ into docs/leaderboard.md, or say which may not stand there.

python experiments/leaderboard.py
"""

from __future__ import annotations

from pathlib import Path

from model_cards import placed

from rcare_marl.baselines.evaluation.leaderboard import board

BEGIN, END = "<!-- board: made by experiments/leaderboard.py -->", "<!-- end of the board -->"
PAGE = Path(__file__).resolve().parents[1] / "docs" / "leaderboard.md"

if __name__ == "__main__":
    PAGE.write_text(placed(PAGE.read_text("utf-8"), board(), BEGIN, END), "utf-8")
