"""Write what steps environments with the hashes of its files, for Linux on x86-64.

python experiments/lock.py python3.10 python3.11 python3.12 python3.13

Each interpreter's pip says what it would install for `docs/environments.txt`; all of it goes into
`docs/environments.lock`. `pip install --require-hashes -r docs/environments.lock` takes nothing else.
"""

from __future__ import annotations

import json
import subprocess
from collections import defaultdict
from pathlib import Path

import typer

DOCS = Path(__file__).parents[1] / "docs"
HEAD = "# By experiments/lock.py, from environments.txt: Linux on x86-64.\n"


def main(pythons: list[str]) -> None:
    """Ask each Python's pip, and write the file."""
    wanted: dict[tuple[str, str], set[str]] = defaultdict(set)  # hashes by name and version
    takers: dict[tuple[str, str], list[str]] = defaultdict(list)  # and the Pythons that take it
    versions = []
    for python in pythons:
        tell = "import sys; print('%d.%d' % sys.version_info[:2])"
        versions.append(subprocess.check_output([python, "-c", tell], text=True).strip())
        dry = "-m pip install --quiet --dry-run --ignore-installed --report - -r".split()
        told = subprocess.check_output([python, *dry, str(DOCS / "environments.txt")])
        for each in json.loads(told)["install"]:
            about = each["metadata"]
            key = about["name"].lower().replace("_", "-"), about["version"]
            wanted[key].add(each["download_info"]["archive_info"]["hashes"]["sha256"])
            takers[key].append(versions[-1])
    lines = [HEAD]
    for (name, version), hashes in sorted(wanted.items()):
        taken = takers[name, version]
        where = "" if taken == versions else f' ; python_version in "{" ".join(taken)}"'
        lines.append(f"{name}=={version}{where}")
        lines[-1] += "".join(f" \\\n    --hash=sha256:{each}" for each in sorted(hashes))
    (DOCS / "environments.lock").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    typer.run(main)
