"""The command `coach`: the page on which the coach exercises with somebody."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rcare_marl.console import print_line
from rcare_marl.errors import ConfigError, MissingPackageError

from .interruption import run_until_interrupted
from .parameter import Opens
from .serving import LOOPBACK as LOOPBACK
from .serving import PORT, serve_page
from .serving import bound as bound

if TYPE_CHECKING:
    from rcare_marl.agents.coaching.exercise import Exercise
    from rcare_marl.baselines.coaching.page.server import Service

LEVELS = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0)  # times the usual noise
PROPOSED = Path("runs") / "coaching"

coach = typer.Typer(add_completion=False, context_settings={"help_option_names": ["-h", "--help"]})


@coach.callback(invoke_without_command=True)
def serve(
    context: typer.Context,
    port: Annotated[
        int | None,
        typer.Option(
            min=0,
            max=65535,
            help=f"Where to serve; {PORT} if left out, or a free one if it is taken.",
        ),
    ] = None,
    open_: Opens = True,
    record: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help=f"Where sessions go, such as {PROPOSED}; each person is asked on the page first. "
            "Nothing is recorded if left out.",
        ),
    ] = None,
    exercise: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME", help="Offer this one, by name or YAML file; may be given several times."
        ),
    ] = None,
    host: Annotated[
        str, typer.Option(help="Address to serve at; all but this computer's own need HTTPS.")
    ] = LOOPBACK,
    certificate: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Of HTTPS, in PEM.")
    ] = None,
    key: Annotated[Path | None, typer.Option(metavar="FILE", help="Of HTTPS, in PEM.")] = None,
) -> None:
    """Exercise with the coach, on a page in your browser or in a VR headset, until Ctrl-C.

    It is reached from this computer only. Choose on the page who watches you: a headset, or a webcam.

    Example: rcare-marl coach

    Example: rcare-marl coach --record runs/coaching --exercise mine.yaml
    """
    if context.invoked_subcommand is not None:
        return
    try:
        from rcare_marl.baselines.coaching.page.server import Service
    except ImportError as error:
        if (error.name or "").split(".")[0] != "aiohttp":
            raise
        raise MissingPackageError("the coach's page", "coach") from error
    from rcare_marl.baselines.coaching.page.packages import packages_folder

    _check_address(host, certificate, key)
    _check_recording(record)
    service = Service(
        packages=packages_folder(),
        record=record,
        exercises=_offered(exercise or None),
        host=host,
        is_secure=certificate is not None,
    )
    run_until_interrupted(_serve(service, port, certificate, key, opens=open_))


@coach.command("evaluate")
def evaluate(
    source: Annotated[
        str, typer.Option(help="Where poses come from: hands, joints, landmarks or camera.")
    ] = "hands",
    users: Annotated[int, typer.Option(min=1, help="How many synthetic people.")] = 40,
    seed: Annotated[int, typer.Option(min=0, help="Of the people and all they do.")] = 0,
    exercise: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="One of those to do, by name or YAML file; may be given several times.",
        ),
    ] = None,
    split: Annotated[
        str, typer.Option(help="test, or development, on whom limits and weights were chosen.")
    ] = "test",
    processes: Annotated[
        int | None,
        typer.Option(min=1, help="How many people at once; one a core if left out."),
    ] = None,
    trouble: Annotated[
        str | None,
        typer.Option(
            help="What goes wrong with headset and hands: drift, hand_lost, swapped, stature or slumped."
        ),
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Repeat it at every --level and draw that, as a PNG."),
    ] = None,
    level: Annotated[
        list[float] | None,
        typer.Option(
            metavar="FACTOR",
            help="Repeat it with so many times the noise; may be given several times. "
            f"With --plot and without it: {', '.join(f'{each:g}' for each in LEVELS)}.",
        ),
    ] = None,
    output: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Where the numbers go as JSON.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Measure how well right exercise is told from wrong, over synthetic people.

    Each of them does every exercise rightly three times, wrongly in fourteen ways, at some distance from each
    of five limits, and something else.

    Example: rcare-marl coach evaluate --source hands --seed 7

    Example: rcare-marl coach evaluate --source joints --plot noise.png
    """
    from . import coach_evaluation as trial

    levels = tuple(level or (LEVELS if plot is not None else ()))
    trial.evaluate(
        source=source,
        users=users,
        seed=seed,
        split=split,
        exercises=tuple(exercise or ()),
        trouble=trouble,
        processes=processes or os.cpu_count() or 1,
        levels=levels,
        plot=plot,
        output=output,
        as_json=as_json,
    )


def _check_address(host: str, certificate: Path | None, key: Path | None) -> None:
    """Refuse half of HTTPS, and an address that others reach without it."""
    from rcare_marl.own_host import is_loopback

    if (certificate is None) != (key is None):
        raise ConfigError("--certificate and --key belong together")
    if not is_loopback(host):
        if certificate is None:
            raise ConfigError(
                f"at {host} others can reach the page; browsers then give it a headset only over HTTPS, "
                "so say --certificate FILE --key FILE"
            )
        print_line(
            f"warning: whoever reaches {host} and gets to know the address with its token can begin sessions"
        )


def _offered(names: Sequence[str] | None) -> Sequence[Exercise]:
    """Return the exercises of these names or files, each of another name; all that ship if None."""
    from rcare_marl.agents.coaching.exercise import load_exercises

    found = load_exercises(names)
    if len({each.name for each in found}) != len(found):
        raise ConfigError(f"--exercise must name each once, got {', '.join(names or ())}")
    return found


def _check_recording(record: Path | None) -> None:
    """Say before anybody has exercised that a recording cannot be written."""
    if record is None:
        return
    try:
        import h5py  # type: ignore[import-untyped, unused-ignore]  # noqa: F401
    except ImportError as error:
        raise MissingPackageError("recording a session", "coach") from error
    try:
        record.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=record).close()  # it may be there and not be writable
    except OSError as error:
        raise ConfigError(f"cannot record to {record}: {error.strerror}") from error


async def _serve(
    service: Service, port: int | None, certificate: Path | None, key: Path | None, *, opens: bool
) -> None:
    from rcare_marl.baselines.coaching.page.server import Server, secured

    context = None
    if certificate is not None and key is not None:
        for option, file in (("--certificate", certificate), ("--key", key)):
            if not file.is_file():
                raise ConfigError(f"{option}: there is no file {file}")
        try:
            context = secured(certificate, key)
        except OSError as error:
            raise ConfigError(
                f"{certificate} and {key} are no certificate and key: {error}"
            ) from error
    listening = bound(service.host, port)
    server = Server(service)
    notes = (
        ()
        if service.record
        else (f"nothing is recorded; --record {PROPOSED} would ask on the page",)
    )
    await serve_page(server, "the coach", listening, notes=notes, context=context, opens=opens)
