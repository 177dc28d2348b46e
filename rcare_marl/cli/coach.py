"""The command `coach`: the page on which the coach exercises with somebody."""

from __future__ import annotations

import asyncio
import socket
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rcare_marl.errors import ConfigError, MissingPackageError

from .console import print_line

if TYPE_CHECKING:
    from .coaching.server import Service

LOOPBACK = "127.0.0.1"
PORT = 8765
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
    open_: Annotated[
        bool, typer.Option("--open/--no-open", help="Whether to open the page in your browser.")
    ] = True,
    record: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help=f"Where sessions go, such as {PROPOSED}; each person is asked on the page first. "
            "Nothing is recorded if left out.",
        ),
    ] = None,
    webcam: Annotated[
        Path | None,
        typer.Option(
            metavar="MODEL", help="Offer this computer's webcam, with this pose landmarker."
        ),
    ] = None,
    camera: Annotated[int, typer.Option(min=0, help="Number of the webcam.")] = 0,
    host: Annotated[
        str, typer.Option(help="Address to serve at; all but this computer's own need HTTPS.")
    ] = LOOPBACK,
    certificate: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Of HTTPS, in PEM.")
    ] = None,
    key: Annotated[Path | None, typer.Option(metavar="FILE", help="Of HTTPS, in PEM.")] = None,
) -> None:
    """Exercise with the coach, on a page in your browser or in a VR headset, until Ctrl-C.

    It is reached from this computer only. Press Enter VR on the page if you have a headset.

    Example: rcare-marl coach

    Example: rcare-marl coach --record runs/coaching
    """
    if context.invoked_subcommand is not None:
        return
    try:
        from .coaching.server import Service, is_loopback
    except ImportError as error:
        if (error.name or "").split(".")[0] != "aiohttp":
            raise
        raise MissingPackageError("the coach's page", "coach") from error
    from .coaching.three import three_folder
    from .coaching.webcam import Webcam

    if (certificate is None) != (key is None):
        raise ConfigError("--certificate and --key belong together")
    if not is_loopback(host):
        if certificate is None:
            raise ConfigError(
                f"at {host} others can reach the page; browsers then give it a headset only over HTTPS, "
                "so say --certificate FILE --key FILE"
            )
        print_line(
            f"warning: whoever reaches {host} can open the page and begin sessions of their own"
        )
    _check_recording(record)
    service = Service(
        three=three_folder(),
        record=record,
        camera=None if webcam is None else Webcam.of_model(webcam, camera),
        host=host,
        is_secure=certificate is not None,
    )
    try:
        asyncio.run(_serve(service, port, certificate, key, opens=open_))
    except KeyboardInterrupt:  # the way to end it, so no failure
        print_line("stopped")


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
    except OSError as error:
        raise ConfigError(f"cannot record to {record}: {error.strerror}") from error


async def _serve(
    service: Service, port: int | None, certificate: Path | None, key: Path | None, *, opens: bool
) -> None:
    from aiohttp import web

    from .coaching.server import Server, secured

    context = None
    if certificate is not None and key is not None:
        try:
            context = secured(certificate, key)
        except OSError as error:
            raise ConfigError(
                f"{certificate} and {key} are no certificate and key: {error}"
            ) from error
    listening = bound(service.host, port)
    runner = web.AppRunner(Server(service).app, access_log=None, handle_signals=False)
    await runner.setup()
    try:
        await web.SockSite(runner, listening, ssl_context=context, shutdown_timeout=2.0).start()
        name = f"[{service.host}]" if ":" in service.host else service.host
        url = f"http{'s' if service.is_secure else ''}://{name}:{listening.getsockname()[1]}/"
        print_line(f"the coach is at {url}  (Ctrl-C ends)")
        if service.record is None:
            print_line(f"nothing is recorded; --record {PROPOSED} would ask on the page")
        if opens:
            webbrowser.open(url)
        await asyncio.Event().wait()
    finally:
        await runner.cleanup()


def bound(host: str, port: int | None) -> socket.socket:
    """Return a socket that listens: at a port, or where none is given to the usual one or a free one.

    Raises:
        ConfigError: If it cannot be bound.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    tries = (PORT, 0) if port is None else (port,)
    for i, number in enumerate(tries):
        out = socket.socket(family, socket.SOCK_STREAM)
        out.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            out.bind((host, number))
            out.listen()
        except OSError as error:
            out.close()
            if i == len(tries) - 1:
                raise ConfigError(
                    f"cannot serve at {host}, port {number}: {error.strerror}; --port 0 takes a free one"
                ) from error
            continue
        return out
    raise AssertionError("unreachable")


__all__ = ["bound", "coach"]
