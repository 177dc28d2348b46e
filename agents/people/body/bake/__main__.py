"""Bake the skins: `python -m rcare_marl.agents.people.body.bake [NAME ...]` (extra: `bake`)."""

from __future__ import annotations

import argparse
import json
import logging
from pathlib import Path

import numpy as np

from rcare_marl import assets

from .anny_source import AnnySource
from .basis import BASIS_FILE, BasisSource
from .dressed import dress
from .make_basis import basis_error, make_basis
from .recipe import load_recipes
from .shape import solve_body

_LOG = logging.getLogger("bake")


def main() -> None:
    """Bake the bodies named on the command line, or all."""
    recipes = load_recipes()
    parser = argparse.ArgumentParser(
        prog="python -m rcare_marl.agents.people.body.bake", description=__doc__
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(recipes)}")
    parser.add_argument(
        "--out",
        type=Path,
        default=Path(str(assets.ROOT)) / "avatars" / "bodies",
        help="folder for the npz files",
    )
    parser.add_argument(
        "--basis",
        action="store_true",
        help=f"make the shape basis, {BASIS_FILE.name}, in place of bodies",
    )
    options = parser.parse_args()
    if unknown := set(options.names) - set(recipes):
        parser.error(f"unknown bodies {sorted(unknown)}; known: {', '.join(recipes)}")
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    source = AnnySource()
    if options.basis:
        np.savez_compressed(BASIS_FILE, **make_basis(source))  # type: ignore[arg-type]
        for kind, error in basis_error(source, BasisSource()).items():
            _LOG.info("%s: %s", kind, error)
        return
    for name in options.names or recipes:
        arrays = dress(source, name, recipes[name], solve_body(source, recipes[name]))
        file = options.out / f"{name}.npz"
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
        meta = json.loads(str(arrays["meta_json"]))
        made = meta["height_m"], meta["mass_kg"], len(arrays["vertices"])
        size = file.stat().st_size // 1024
        _LOG.info("%-10s %.3f m %.1f kg, %d vertices, %d kB", name, *made, size)


if __name__ == "__main__":
    main()
