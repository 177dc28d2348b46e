"""Every block of code in README, CONTRIBUTING and docs runs alone; one that cannot says why.

A comment before a block tells how: `<!-- test: slow; 10_000 => 64; here.npz from a/file.npz;
not run: needs a headset -->`. A YAML block with `file: name.yaml` is written before the others of
its page run, as its reader would do.
"""

from __future__ import annotations

import json
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
from typer.core import TyperGroup
from typer.main import get_command

from rcare_marl import CareHome, make
from rcare_marl.agents.people.avatar import load_avatar
from rcare_marl.baselines.training.config import default_config, load_config
from rcare_marl.cli import app
from rcare_marl.config import read_yaml
from rcare_marl.envs.devices.device_model import load_device

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
_BLOCK = re.compile(
    r"^(?: *<!-- test: (?P<marks>[^\n]*) -->\n)?(?P<indent> *)```(?P<kind>\w*)\n(?P<code>.*?)^ *```$",
    re.DOTALL | re.MULTILINE,
)
SHELL = ("sh", "bash")
PROSE = ("", "text", "bibtex", "toml")  # what is printed, cited or configured


@dataclass(frozen=True)
class Block:
    page: Path
    line: int
    kind: str
    code: str
    marks: tuple[str, ...]

    @property
    def name(self) -> str:
        return f"{self.page.stem}-{self.line}"

    @property
    def why_not(self) -> str:
        return next((m[8:].strip() for m in self.marks if m.startswith("not run:")), "")

    def files(self) -> dict[str, str]:
        """Return what has to lie beside it, and where in the repository it lies."""
        pairs = (mark.split(" from ") for mark in self.marks if " from " in mark)
        return {pair[0]: pair[1] for pair in pairs}

    def cheap(self) -> str:
        code = self.code
        for mark in self.marks:
            if " =>" in mark:
                old, _, new = mark.partition(" =>")
                assert old in code, f"nothing to replace: {old}"
                code = code.replace(old, new.removeprefix(" "))
        return code


def _blocks() -> list[Block]:
    found = []
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for match in _BLOCK.finditer(text):
            line = text.count("\n", 0, match.start("indent")) + 1
            marks = tuple(mark.strip() for mark in (match["marks"] or "").split(";") if mark)
            code = re.sub(rf"^{match['indent']}", "", match["code"], flags=re.MULTILINE)
            found.append(Block(page, line, match["kind"], code, marks))
    for book in NOTEBOOKS:  # each as one block, with its marks among what it says of itself
        data = json.loads(book.read_text(encoding="utf-8"))
        cells = ["".join(c["source"]) for c in data["cells"] if c["cell_type"] == "code"]
        marks = tuple(data["metadata"]["rcare_marl"]["test"])
        found.append(Block(book, 1, "python", "\n".join(cells), marks))
    return found


BLOCKS = _blocks()


def _cases(*kinds: str, where: Callable[[Block], object] = bool) -> list[object]:
    return [
        pytest.param(
            block,
            id=block.name,
            marks=[pytest.mark.slow] if "slow" in block.marks else [],
        )
        for block in BLOCKS
        if block.kind in kinds and not block.why_not and where(block)
    ]


def _lay_out(block: Block, folder: Path) -> None:
    for name, origin in block.files().items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / origin, folder / name)
    for other in BLOCKS:
        names = [mark[6:] for mark in other.marks if mark.startswith("file: ")]
        if other.page == block.page and names:
            (folder / names[0]).write_text(other.code, encoding="utf-8")


@pytest.mark.parametrize("block", _cases("python"))
def test_python_runs_alone(block: Block, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    _lay_out(block, tmp_path)
    code = block.cheap()
    if "__name__" not in code and "register_" not in code:  # nothing is left to later tests
        exec(compile(code, f"{block.page.name}:{block.line}", "exec"), {"__name__": "__main__"})
        return
    (tmp_path / "block.py").write_text(code, encoding="utf-8")  # other processes import it
    subprocess.run([sys.executable, "block.py"], check=True, timeout=300)


def _commands(block: Block) -> list[list[str]]:
    text = block.cheap().replace("\\\n", " ")
    lines = (line.removeprefix("$ ") for line in text.splitlines())
    return [
        shlex.split(line, comments=True)[1:] for line in lines if line.startswith("rcare-marl ")
    ]


@pytest.mark.parametrize(
    "block", [pytest.param(b, id=b.name) for b in BLOCKS if b.kind in ("", *SHELL)]
)
def test_commands_have_the_options_that_are_shown(block: Block) -> None:
    known = get_command(app).commands  # type: ignore[attr-defined]
    for name, *words in _commands(block):
        known[name].make_context(name, words)


@pytest.mark.slow
@pytest.mark.parametrize("block", _cases("", *SHELL, where=_commands))
def test_commands_run(block: Block, tmp_path: Path) -> None:
    _lay_out(block, tmp_path)
    for words in _commands(block):
        spread = []  # as a shell would
        for word in words:
            spread += sorted(map(str, tmp_path.glob(word))) if "*" in word else [word]
        run = [sys.executable, "-c", "from rcare_marl.cli import main; main()", *spread]
        subprocess.run(run, check=True, timeout=600, cwd=tmp_path)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_in_a_sentence_have_the_arguments_that_are_named(page: Path) -> None:
    for code in re.findall(r"`rcare-marl ([^`\n]+)`", page.read_text()):
        words = shlex.split(code)
        if any(re.search(r"\.\.\.|[A-Z]{2}|[<>|]", word) for word in words):
            continue  # something is to be filled in
        command = get_command(app)
        while isinstance(command, TyperGroup) and words and words[0] in command.commands:
            command = command.commands[words.pop(0)]
        if isinstance(command, TyperGroup):
            assert not words or words[0].startswith("-"), code
        elif words:
            command.make_context("rcare-marl", words)


def test_what_does_not_run_says_why() -> None:
    for block in BLOCKS:
        shown = [line for line in block.code.splitlines() if line and not line.startswith("#")]
        assert block.kind in ("python", "yaml", *SHELL, *PROSE), block.name
        if block.kind in SHELL and not block.why_not:
            assert all("rcare-marl " in line or line.startswith(" ") for line in shown), block.name


def _read_avatar(file: Path) -> object:
    return load_avatar(str(file))


def _read_views(file: Path) -> object:
    return load_config({**default_config("feeding"), **read_yaml(file)})


def _read_curriculum(file: Path) -> object:
    return load_config({**default_config("toileting"), **read_yaml(file)})


READERS: dict[str, Callable[[Path], object]] = {  # of the YAML of a page
    "CONTRIBUTING": _read_avatar,
    "avatars": _read_avatar,
    "curriculum": _read_curriculum,
    "devices": lambda file: load_device(str(file)),
    "learning": _read_views,
    "homes": lambda file: CareHome.load(str(file), level=3),
    "randomisation": lambda file: make("feeding", randomise=str(file)),
}


@pytest.mark.parametrize("block", _cases("yaml"))
def test_a_file_that_is_shown_can_be_read(block: Block, tmp_path: Path) -> None:
    file = tmp_path / "shown.yaml"
    code = block.cheap().replace(
        "bodies/natalia.npz", str(ROOT / "assets/avatars/bodies/natalia.npz")
    )
    file.write_text(code, encoding="utf-8")
    READERS[block.page.stem](file)


@pytest.mark.slow
def test_the_site_builds_strictly_fetches_nothing_and_is_searched(tmp_path: Path) -> None:
    site = tmp_path / "site"
    config = str(ROOT / "docs" / "site" / "mkdocs.yml")
    mkdocs = [
        sys.executable,
        "-m",
        "mkdocs",
        "build",
        "--strict",
        "-q",
        "-f",
        config,
        "-d",
        str(site),
    ]
    subprocess.run(mkdocs, check=True, capture_output=True)
    fetched = re.compile(r"<(?:script|link|img|iframe)\b[^>]*?(?:src|href)=[\"']?(?:https?:)?//")
    for page in site.rglob("*.html"):
        assert not fetched.search(page.read_text(encoding="utf-8")), page.name
    entries = json.loads((site / "search" / "search_index.json").read_text(encoding="utf-8"))[
        "docs"
    ]
    found = {
        entry["location"].partition("#")[0] for entry in entries
    }  # test_docs_browser.py asks it
    assert found >= {f"notebooks/{book.stem}.html" for book in NOTEBOOKS} and len(NOTEBOOKS) == 3


def test_every_link_leads_to_a_file_and_a_heading_that_are_there() -> None:
    broken = []
    for page in PAGES:
        for target in _links(page.read_text(encoding="utf-8")):
            place, _, anchor = target.partition("#")
            file = (page.parent / place).resolve() if place else page
            if not file.exists():
                broken.append(f"{page.name}: {target}")
            elif anchor and anchor not in _headings(file):
                broken.append(f"{page.name}: {target}")
    assert not broken, "\n".join(broken)


def _links(text: str) -> list[str]:
    """Return what a page links to in the repository."""
    text = re.sub(r"^ *```.*?^ *```$|`[^`\n]*`", "", text, flags=re.DOTALL | re.MULTILINE)
    found = re.findall(r"\]\(<?([^)\s>]+)>?(?: \"[^\"]*\")?\)", text)
    return [each for each in found if not re.match(r"[a-z]+:", each)]


def _headings(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub and the site name them."""
    text = re.sub(
        r"^ *```.*?^ *```$", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE
    )
    titles = re.findall(r"^#+ (.+)$", text, flags=re.MULTILINE)
    titles = [re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", each) for each in titles]
    return {re.sub(r"[^\w\- ]", "", each.lower()).strip().replace(" ", "-") for each in titles}
