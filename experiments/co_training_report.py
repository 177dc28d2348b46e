"""Tables and pictures of what `co_training.py` found, for its page in the docs.

`python experiments/co_training.py report --out DIR --docs docs/co_training.md` fills in the parts of the
page that stand between `<!-- begin NAME -->` and `<!-- end NAME -->`. Every number comes from the records.
"""

from __future__ import annotations

import csv
import json
import re
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from rcare_marl.baselines.evaluation.cross_play import CrossPlay
from rcare_marl.baselines.evaluation.episode_figure import PALETTE, style
from rcare_marl.baselines.evaluation.statistic import hierarchical_interval
from rcare_marl.baselines.partners import TEMPERAMENTS
from rcare_marl.console import markdown_table
from rcare_marl.pose import Array

AVATARS = ("daniel", "jose", "karan", "kim", "morgan", "natalia")
TREE, THROUGH_MUSCLES = "karan_cooperative", "karan_muscles"
WHO = {
    "a": "robot; behaviour tree",
    "b": "robot; behaviour tree through muscles",
    "c": "robot and recipient",
    "p": "robot; trees of five individuals",
    "d": "robot, recipient, caregiver (dressing)",
    "m": "recipient through muscles; scripted robot",
    "e": "robot; a tree, another body each time",
    "f": "robot; trees of five individuals, another body each time",
    "g": "robot and recipient, another body each time",
    "h": "robot and recipient through muscles, another body each time",
    "k": "robot; trees of three individuals and two learners of (g), another body each time",
}
BODIES = "efgkh"
COLOURS = {letter: PALETTE[k] for letter, k in zip("acmpb", range(5), strict=True)}
RESAMPLES, BIG_PICTURE = 5000, ("co_training_cross_play", "co_training_leave_one_out")
CURVES = "co_training_curves"


def report(out: Path, docs: Path | None) -> str:
    """Return all tables in Markdown; write them and the pictures to `out`, and into a page.

    Args:
        out: Folder of the experiment.
        docs: The page to fill in; none if None.
    """
    records = out / "records"
    trained = sorted(records.glob("train_*.json"))
    bodies = [file for file in trained if file.stem.split("_")[1] in BODIES]
    parts = {}
    for name, files in (
        ("trainings", [file for file in trained if file not in bodies]),
        ("trainings_bodies", bodies),
    ):
        if files:
            parts[name] = _trainings(files)
    if (records / "strangers.json").is_file():
        parts["strangers"] = _strangers(
            json.loads((records / "strangers.json").read_text())["found"]
        )
    if (records / "cross_play.json").is_file():
        found = CrossPlay.read(records / "cross_play.json")
        parts |= _pairs(found)
        title = "Feeding: success [%] of robots with recipients; framed: trained together"
        found.draw(out / f"{BIG_PICTURE[0]}.png", title=title, partners_down=True)
    if (records / "leave_one_out.json").is_file():
        found = CrossPlay.read(records / "leave_one_out.json")
        parts["leave_one_out"] = _held_out(found)
        shown = found.select(partners=[f"{avatar}_cooperative" for avatar in AVATARS])
        title = "Feeding: success [%] with each avatar; framed: in training"
        shown.draw(out / f"{BIG_PICTURE[1]}.png", title=title)
    if (records / "dressing.json").is_file():
        parts["dressing"] = _dressing(json.loads((records / "dressing.json").read_text()))
    _draw_curves(out)
    text = "\n\n".join(f"## {name}\n\n{part}" for name, part in parts.items()) + "\n"
    (out / "report.md").write_text(text, encoding="utf-8")
    if docs is not None:
        _fill_in(docs, parts)
        for picture in (*BIG_PICTURE, CURVES):
            if (out / f"{picture}.png").is_file():
                shutil.copyfile(out / f"{picture}.png", docs.parent / "images" / f"{picture}.png")
    return text


def _fill_in(page: Path, parts: Mapping[str, str]) -> None:
    text = page.read_text(encoding="utf-8")
    for name, part in parts.items():
        begin, end = f"<!-- begin {name} -->", f"<!-- end {name} -->"
        pattern = re.compile(f"{re.escape(begin)}.*?{re.escape(end)}", re.DOTALL)
        block = f"{begin}\n{part}\n{end}".replace("\\", "\\\\")  # it is no pattern
        text, count = pattern.subn(block, text)
        if count != 1:
            raise SystemExit(f"{page} needs the marks {begin} and {end}, once")
    page.write_text(text, encoding="utf-8")


def _trainings(files: Sequence[Path]) -> str:
    """Return what was trained, how long, and how well it does with its own partner."""
    rows = []
    for file in files:
        record = json.loads(file.read_text())
        letter = record["run"].split("_")[0]
        who = "robot; tree of five avatars" if letter == "without" else WHO[letter]
        config = record["config"]
        spent = (f"{record['steps']:,}", f"{record['minutes']:.1f}")
        success = f"{100 * record['success']:.0f}"
        rows.append((record["run"], who, config["algo"].upper(), *spent, success))
    head = ("training", "who learns; with whom", "algorithm", "steps", "minutes")
    return markdown_table((*head, "success at its best [%]"), rows)


def _strangers(found: Mapping[str, Mapping[str, Sequence[tuple[bool, float]]]]) -> str:
    """Return success with bodies and partners that nobody met in training, and what (e) is bettered by."""
    rows, sides = [], {}
    learners = [name for name in found["scripted"] if name not in TEMPERAMENTS]
    for letter in (*BODIES, "scripted"):
        runs = [name for name in found if name == letter or name.startswith(f"{letter}_")]
        if not runs:
            continue
        cells = [f"({letter}) {WHO[letter]}" if letter in WHO else letter, str(len(runs))]
        for partners in (*([mood] for mood in TEMPERAMENTS), TEMPERAMENTS, learners):
            met = [[e for p in partners if p != run for e in found[run][p]] for run in runs]
            done = [[float(success) for success, _ in episodes] for episodes in met]
            low, high = hierarchical_interval(done)
            mean = 100 * np.mean([np.mean(each) for each in done])
            most = max(force for episodes in met for _, force in episodes)
            cells.append(f"{mean:.0f} ({100 * low:.0f} to {100 * high:.0f}), {most:.0f} N")
            if partners is TEMPERAMENTS:
                sides[letter] = done
        rows.append(cells)
    head = ("robot; with whom", "runs", *TEMPERAMENTS, "all four", "learners of (g), never met")
    said = [_gain(sides[letter], sides["e"], letter) for letter in BODIES[1:] if letter in sides]
    return "\n\n".join((markdown_table(head, rows), " ".join(said)))


def _gain(new: Sequence[Sequence[float]], old: Sequence[Sequence[float]], letter: str) -> str:
    """Return in words what a scenario gains on (e)."""
    rng = np.random.default_rng(0)
    draws = 100 * (_resampled(new, rng) - _resampled(old, rng))
    low, high = np.percentile(draws, (2.5, 97.5))
    gain = 100 * (np.mean(new) - np.mean(old))
    return f"({letter}) less (e), all four: {gain:+.1f} points ({low:+.1f} to {high:+.1f})."


def _runs(found: CrossPlay, letter: str) -> list[str]:
    return [name for name in found.policies if name.startswith(f"{letter}_")]


def _share(found: CrossPlay, letter: str, partners: Sequence[str]) -> float:
    """Return the mean success of the robots of a scenario with some partners [%]."""
    return 100 * float(found.select(_runs(found, letter), partners).success.mean())


def _values(found: CrossPlay, policy: str, partners: Sequence[str], measure: str) -> list[float]:
    values = found.select([policy], partners).values[measure]
    return [float(v) for v in values.ravel()]


def _pairs(found: CrossPlay) -> dict[str, str]:
    """Return the parts of the page about the matrix of all robots and recipients."""
    zoo = [name for name in found.partners if _temperament(name) is not None]
    unseen = [name for name in zoo if name != TREE]
    learned = [name for name in found.partners if name.startswith("c_")]
    return {
        "two_by_two": _two_by_two(found, learned, unseen),
        "verdict": "\n\n".join(_verdict(found, unseen, letter) for letter in "cp"),
        "gap": _gaps(found, learned),
        "temperaments": _by_temperament(found, zoo),
    }


def _temperament(partner: str) -> str | None:
    avatar, _, mood = partner.partition("_")
    return mood if avatar in AVATARS and mood in TEMPERAMENTS else None


def _cell(found: CrossPlay, pairs: Mapping[str, Sequence[str]]) -> str:
    """Return success with its interval, and steps, of some robots, each with partners of its own."""
    pairs = {robot: met for robot, met in pairs.items() if met}
    if not pairs:
        return "–"
    success = [_values(found, robot, met, "success") for robot, met in pairs.items()]
    steps = np.concatenate([_values(found, robot, met, "steps") for robot, met in pairs.items()])
    mean = float(np.mean([np.mean(each) for each in success]))
    low, high = hierarchical_interval(success)
    return f"{100 * mean:.1f} ({100 * low:.0f} to {100 * high:.0f}), {steps.mean():.0f} steps"


def _two_by_two(found: CrossPlay, learned: Sequence[str], unseen: Sequence[str]) -> str:
    rows = []
    kinds = {
        "a": "(a) learned with the tree",
        "b": "(b) with the tree through muscles",
        "c": "(c) learned together",
        "p": "(p) with a population",
    }
    robots = {title: _runs(found, letter) for letter, title in kinds.items()}
    for title, names in {**robots, "scripted": ["scripted"]}.items():
        own = {name: found.own.get(name, ()) for name in names}
        rows.append(
            (
                title,
                _cell(found, {name: [TREE] for name in names}),
                _cell(found, {name: [q for q in learned if q in own[name]] for name in names}),
                _cell(found, {name: [q for q in learned if q not in own[name]] for name in names}),
                _cell(found, {name: unseen for name in names}),
            )
        )
    head = ("robot", "the tree", "its own learner", "learners of (c) it never met", "zoo, unseen")
    return markdown_table(head, rows)


def _verdict(found: CrossPlay, unseen: Sequence[str], new: str) -> str:
    """Return in words whether a scenario beats (a) with partners that neither has met."""
    sides = {}
    for letter in ("a", new):
        sides[letter] = [_values(found, name, unseen, "success") for name in _runs(found, letter)]
    if not all(sides.values()):
        return f"(a) or ({new}) was not trained."
    rng = np.random.default_rng(0)
    draws = _resampled(sides[new], rng) - _resampled(sides["a"], rng)
    low, high = (100 * float(x) for x in np.percentile(draws, (2.5, 97.5)))
    means = {letter: _share(found, letter, unseen) for letter in sides}
    gain = means[new] - means["a"]
    said = "beats" if low > 0 else "is worse than" if high < 0 else "is not clearly different from"
    bodies = [name for name in unseen if not name.startswith(TREE.split("_")[0])]
    others = {letter: _share(found, letter, bodies) for letter in sides}
    return (
        f"With the {len(unseen)} partners of the zoo that neither met in training, ({new}) {said} (a): "
        f"{means[new]:.1f} % against {means['a']:.1f} % success, a difference of {gain:+.1f} points "
        f"(95 % interval {low:+.1f} to {high:+.1f}; runs and episodes resampled, {len(sides[new])} and "
        f"{len(sides['a'])} runs). With the {len(bodies)} of them who have other bodies: {others[new]:.1f} % "
        f"against {others['a']:.1f} %."
    )


def _resampled(runs: Sequence[Sequence[float]], rng: np.random.Generator) -> Array:
    """Return means over runs, drawn again with their episodes, shape [RESAMPLES]."""
    table = np.asarray(runs, np.float64)
    out = np.zeros(RESAMPLES)
    for i in range(RESAMPLES):
        chosen = table[rng.integers(len(table), size=len(table))]
        out[i] = chosen[:, rng.integers(table.shape[1], size=table.shape[1])].mean()
    return out


def _gaps(found: CrossPlay, learned: Sequence[str]) -> str:
    """Return success of (c) with its own recipient and with those of other seeds."""
    robots = _runs(found, "c")
    if not robots or len(learned) < 2:
        return "Fewer than two trainings of (c)."
    part = found.select(robots, learned)
    gap, steps = part.gap(), part.gap("steps")
    return (
        f"Among the {len(robots)} trainings of (c): success with the recipient that a robot learned with "
        f"{100 * gap.own:.0f} %, with those of the other seeds {100 * gap.others:.0f} %; "
        f"{steps.own:.0f} and {steps.others:.0f} control steps.\n\n{part.table()}".rstrip()
    )


def _by_temperament(found: CrossPlay, zoo: Sequence[str]) -> str:
    rows = []
    for name in found.policies:
        cells = [name]
        for mood in TEMPERAMENTS:
            met = [partner for partner in zoo if _temperament(partner) == mood]
            part = found.select([name], met)
            force = float(part.matrix("peak_force").max())
            cells.append(f"{100 * part.success.mean():.0f} ({force:.1f} N)")
        if THROUGH_MUSCLES in found.partners:
            muscles = found.select([name], [THROUGH_MUSCLES])
            cells.append(f"{100 * muscles.success.mean():.0f}")
        rows.append(cells)
    return markdown_table(("robot", *TEMPERAMENTS, "tree through muscles"), rows)


def _held_out(found: CrossPlay) -> str:
    """Return success on each avatar of the robot that never met it, and of those of (a)."""
    default, rows = _runs(found, "a"), []
    totals: dict[str, list[Array]] = {"without": [], "default": [], "scripted": []}
    for avatar in AVATARS:
        held_out = [name for name in found.policies if name.startswith(f"without_{avatar}_")]
        if not held_out:
            continue
        cells = [avatar]
        for moods in (["cooperative"], list(TEMPERAMENTS)):
            met = [f"{avatar}_{mood}" for mood in moods]
            for kind, names in (
                ("without", held_out),
                ("default", default),
                ("scripted", ["scripted"]),
            ):
                success = found.select(names, met).success.mean() if names else float("nan")
                cells.append(f"{100 * success:.0f}")
                totals[kind].append(np.array([success, len(moods)]))
        rows.append(cells)
    mean = ["mean"]
    for count in (1, len(TEMPERAMENTS)):
        for kind in totals:
            mean.append(f"{100 * np.mean([v for v, n in totals[kind] if n == count]):.0f}")
    titles = ("five others", "default alone", "scripted")
    head = [
        "never met",
        *(f"{t}, cooperative" for t in titles),
        *(f"{t}, all four" for t in titles),
    ]
    return markdown_table(head, [*rows, mean])


def _dressing(record: Mapping[str, Any]) -> str:
    roles = ("robot", "recipient", "caregiver")
    rows = [
        (
            f"d_{row['seed']}",
            *(row[role] for role in roles),
            f"{row['successes']} of {row['episodes']}",
            f"{row['peak_force_n']:.1f}",
            f"{row['steps_mean']:.0f}",
            f"{row['return']:.1f}",
        )
        for row in record["rows"]
    ]
    head = ("training", *roles, "success", "greatest force [N]", "steps", "return")
    return markdown_table(head, rows)


def _draw_curves(out: Path) -> None:
    """Draw the success of a, b, c, p and m in training over environment steps, if there is one."""
    figure = Figure(figsize=(7.2, 3.2), dpi=150, layout="constrained")
    axis = figure.subplots()
    labelled: set[str] = set()
    for file in sorted((out / "curves").glob("*.csv")):
        letter = file.stem.split("_")[0]
        if letter not in COLOURS:
            continue
        with file.open(newline="") as stream:
            rows = [row for row in csv.DictReader(stream) if row.get("eval_success")]
        label = None if letter in labelled else f"({letter}) {WHO[letter]}"
        labelled.add(letter)
        steps = [float(row["step"]) / 1000 for row in rows]
        success = [100 * float(row["eval_success"]) for row in rows]
        axis.plot(
            steps, success, marker=".", color=COLOURS[letter], linewidth=1.2, alpha=0.8, label=label
        )
    if not labelled:
        return
    axis.set_xlabel("control steps of all environments together [thousand]")
    axis.set_ylabel("success with its partner [%]")
    axis.set_ylim(-3, 103)
    style(axis)
    axis.legend(fontsize=8, frameon=False)
    figure.savefig(out / f"{CURVES}.png")
