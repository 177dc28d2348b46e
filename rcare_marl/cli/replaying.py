"""The commands `replay`, of recorded episodes and of records of evaluations."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import Any

import typer
from rich.text import Text

from rcare_marl.atomic_file import write_whole
from rcare_marl.console import console, print_line
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.datasets import read
from rcare_marl.envs.episode import RecordedEpisode, replay

from .parameter import print_json

RECORD = ".json"  # ending of a record of an evaluation


def run(
    files: Sequence[Path],
    *,
    which: int | None,
    film: Path | None,
    picture: Path | None,
    log: Path | None,
    processes: int,
    as_json: bool,
) -> bool:
    """Play files again and tell of each episode; return whether all came out equal.

    Of datasets all episodes are played, or the one of number `which`.
    """
    if (film or picture or log) and (len(files) > 1 or files[0].suffix == RECORD):
        raise typer.BadParameter("film, picture and log show one recorded episode")
    told, is_equal = [], True
    for file in files:
        if file.suffix == RECORD:
            facts, same = _again(file, processes, quiet=as_json)
            told.append({"file": str(file), "equal": same, **facts})
            is_equal = is_equal and same
            continue
        episodes = read(file, only=which)
        if (film or picture or log) and len(episodes) > 1:
            raise typer.BadParameter(f"{file} has {len(episodes)} episodes: say --episode N")
        for number, episode in enumerate(episodes, which or 0):
            name = str(file) if file.suffix == ".npz" else f"{file}, episode {number}"
            facts, same = _episode(
                name, episode, film=film, picture=picture, log=log, quiet=as_json
            )
            told.append({"file": str(file), "episode": number, "equal": same, **facts})
            is_equal = is_equal and same
    if as_json:
        print_json(told)
    return is_equal


def show(file: Path, *, which: int | None, port: int | None, opens: bool) -> None:
    """Serve the page of a recorded episode, or of all of a file one after the other, until Ctrl-C.

    Raises:
        ConfigError: If there are no recorded episodes in it.
    """
    from .teleoperation import serve_scene

    if file.suffix == RECORD:
        raise typer.BadParameter(f"{file} has no actions to show: --live takes recorded episodes")
    episodes = read(file, only=which)
    scene = (str(episodes[0].header.setup["task"]), ())
    serve_scene(scene, port=port, opens=opens, replays=episodes)


def _again(file: Path, processes: int, *, quiet: bool) -> tuple[dict[str, Any], bool]:
    from . import assessment

    result = assessment.run_again(file, processes=processes)
    if not quiet:
        assessment.show_again(result)
    return asdict(result), not result.differences


def _episode(
    name: str,
    episode: RecordedEpisode,
    *,
    film: Path | None,
    picture: Path | None,
    log: Path | None,
    quiet: bool,
) -> tuple[dict[str, Any], bool]:
    with closing(episode.make()) as env:
        with tempfile.TemporaryDirectory() as scratch:
            made = {"film.mp4": film, "log.rrd": log}
            wanted = {file: Path(scratch) / file for file, out in made.items() if out}
            shown = _Shown(env, wanted.get("film.mp4"), wanted.get("log.rrd"))
            watch: Callable[[CareEnv], None] | None = shown if wanted or picture else None
            try:
                result = replay(episode, env=env, on_step=watch)
                pixels = shown.png() if picture else b""
            finally:
                shown.close()
            for file, out in made.items():
                if out:
                    write_whole(out, wanted[file].read_bytes())
            if picture:
                write_whole(picture, pixels)
    if not quiet:
        header, screen = episode.header, console()
        what = f"{name}: {header.setup['task']}, seed {header.seed}: "
        if result.difference:
            text = f"differs at {result.difference}; equal before"
            screen.print(Text(what + text, style="red"), soft_wrap=True)
            for text in result.elsewhere:
                screen.print(Text(f"  {text}", style="dim"), soft_wrap=True)
        else:
            screen.print(
                Text(f"{what}equal for {result.steps} steps", style="green"), soft_wrap=True
            )
        for written in (film, picture, log):
            if written is not None:
                print_line(f"wrote {written}")
    return asdict(result), not result.difference


class _Shown:
    """What is seen of a replay: a film, a picture of its end, a log of rerun."""

    def __init__(self, env: CareEnv, film: Path | None, log: Path | None) -> None:
        self._env, self._film, self._log = env, None, None
        if log is not None:
            from rcare_marl.rendering.rerun_log import RerunLog

            self._log = RerunLog(log)
        if film is not None:
            from rcare_marl.rendering.film import Film

            self._film = Film(film, env.world, fps=1 / env.task.control_dt)

    def __call__(self, env: CareEnv) -> None:
        if self._log is not None:
            self._log(env)
        if self._film is not None:
            over = "success" if env.task.succeeded() else f"{env.world.time:.1f} s"
            good = env.task.succeeded() if env.is_over else None
            self._film.add(env.task.view(), f"replay of seed {env.seed}", over, good=good)

    def png(self) -> bytes:
        """Return a picture of the scene as it is now."""
        from rcare_marl.rendering.portrait import encoded, snapshot

        return encoded(snapshot(self._env.world, self._env.task.view()))

    def close(self) -> None:
        """Finish the files."""
        if self._log is not None:
            self._log.close()
        if self._film is not None:
            self._film.hold()
            self._film.close()
