"""Write the mean of the networks of several seeds as one policy.

python experiments/mean_policy.py runs/seed0/policy_last.npz runs/seed1/policy_last.npz --out mean.npz
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rcare_marl.baselines.ensemble import mean_of
from rcare_marl.baselines.policy_file import PolicyFile
from rcare_marl.errors import RcareError


def main(
    policies: Annotated[list[Path], typer.Argument(help="Two or more, of one recipe.")],
    out: Annotated[Path, typer.Option(help="Where the mean is written.")],
) -> None:
    """Write the mean of several policies, whole or not at all."""
    try:
        mean_of([PolicyFile.read(policy) for policy in policies]).save(out)
    except RcareError as error:
        raise SystemExit(f"error: {error}") from error
    print(f"wrote {out}")


if __name__ == "__main__":
    typer.run(main)
