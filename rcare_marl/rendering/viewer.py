"""A live view of a world on a web page that this computer serves."""

from __future__ import annotations

import contextlib
import inspect
import logging
import math
import socket
import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from ..body import Body
from ..errors import ConfigError, MissingPackageError
from ..own_host import guarded_websockets
from ..pose import Pose
from ..world import Lines, Skin, World
from .camera import Camera
from .geometry import FLOOR_RGBA, world_parts
from .piece import Piece, split_by_color
from .stroke import segments, skin_opacity

SKIN_RATE = 20.0  # [Hz], how often deforming surfaces are sent
POSE_RATE = 40.0  # [Hz], how often poses are sent
_SPEEDS = (0.1, 4.0)
_LINE_RGB = (168, 143, 116)
_LINE_WIDTH = 3.0  # [pixel], where viser knows no other width
_LONGEST_PAUSE = 0.2  # [s]; slower than that and the world is not made to catch up

_LOG = logging.getLogger(__package__)


class Viewer:
    """A page with the world in three dimensions, a pause button and a speed slider.

    Call `update` once a control step: it sends what moved, waits until the wall clock has caught up
    with the simulated one, and as long as the page says pause.

    Attributes:
        url: Where the page is.
    """

    def __init__(
        self,
        world: World,
        camera: Camera,
        port: int = 0,
        host: str = "127.0.0.1",
        *,
        follow: bool = True,
    ) -> None:
        """Serve the page.

        Args:
            world: What to show.
            camera: Where a visitor's camera starts, and returns to on reset.
            port: Port of the page; 0 takes a free one.
            host: Address to serve on; other computers can see the page at 0.0.0.0.
            follow: Whether `update` keeps the simulation at the speed of the page's slider.

        Raises:
            ConfigError: If the port is impossible.
            MissingPackageError: If viser is not installed.
        """
        if not 0 <= port <= 65535:
            raise ConfigError(f"viewer port must lie in [0, 65535], got {port}")
        try:
            import viser
        except ImportError as error:
            raise MissingPackageError("the viewer", "view") from error
        self._world, self._camera, self.follow = world, camera, follow
        with _quiet(), guarded_websockets(host):
            self._server: Any = viser.ViserServer(
                host=host, port=port or _free_port(host), label="rcare-marl", verbose=False
            )
        self.url = f"http://{host}:{self._server.get_port()}"
        self._running = threading.Event()
        self._running.set()
        self._nodes: list[tuple[Body, int, Pose, Any]] = []  # body, link, place on it, handle
        self._surfaces: list[tuple[Skin, list[tuple[Piece, Any]]]] = []
        self._strokes: list[tuple[Lines, Any, Any]] = []
        self._known: tuple[tuple[int, ...], ...] = ()
        self._anchor = (0.0, 0.0, 1.0)  # wall time, simulated time and speed to pace from
        self._last_simulated = math.inf
        self._sent_poses = self._sent_skins = -math.inf
        self._furnish()
        self._controls()
        self.update()
        _LOG.info("the viewer is at %s", self.url)

    @property
    def is_paused(self) -> bool:
        """Whether the page holds the simulation."""
        return not self._running.is_set()

    @property
    def is_open(self) -> bool:
        """Whether the page is served."""
        return self._server is not None

    def update(self) -> None:
        """Show the present state, then wait for the wall clock and while paused."""
        if self._server is None:
            return
        self._send(time.monotonic())
        while not self._running.wait(0.05) and self._server is not None:
            self._last_simulated = math.inf
        if self.follow:
            self._pace()

    def close(self) -> None:
        """Stop serving; safe to call twice."""
        server, self._server = self._server, None
        self._running.set()
        if server is not None:
            with _quiet():
                server.stop()

    def _furnish(self) -> None:
        scene = self._server.scene
        scene.set_up_direction("+z")
        scene.configure_default_lights(enabled=True, cast_shadow=True)
        # A sky in place of viser's light maps, with which the page takes seconds to fade in.
        scene.configure_environment_map(None)
        scene.add_light_hemisphere(
            "/sky", sky_color=(235, 242, 255), ground_color=(205, 190, 172), intensity=2.2
        )
        self._server.gui.configure_theme(control_layout="collapsible", show_share_button=False)
        self._grid = scene.add_grid(
            "/floor",
            infinite_grid=True,
            cell_size=0.2,
            cell_color=_LINE_RGB,
            section_color=_LINE_RGB,
            fade_distance=14.0,
            shadow_opacity=0.3,
            plane_color=FLOOR_RGBA[:3],
            plane_opacity=1.0,
            position=(0.0, 0.0, -0.003),
        )
        first = self._server.initial_camera
        first.position, first.look_at = tuple(self._camera.eye), tuple(self._camera.target)
        first.up, first.fov = tuple(self._camera.up), math.radians(self._camera.fov_deg)

    def _controls(self) -> None:
        gui = self._server.gui
        button = gui.add_button("Pause")
        speed = gui.add_slider("Speed", min=_SPEEDS[0], max=_SPEEDS[1], step=0.1, initial_value=1.0)
        reset = gui.add_button("Reset camera")
        clock = gui.add_text("Time [s]", initial_value="0.0", disabled=True)
        self._speed, self._clock = speed, clock

        @button.on_click  # type: ignore[untyped-decorator, unused-ignore]
        def _(_event: Any) -> None:
            if self._running.is_set():
                self._running.clear()
                button.label = "Play"
            else:
                self._running.set()
                button.label = "Pause"

        @reset.on_click  # type: ignore[untyped-decorator, unused-ignore]
        def _(_event: Any) -> None:
            for client in self._server.get_clients().values():
                with client.atomic():
                    client.camera.position = tuple(self._camera.eye)
                    client.camera.look_at = tuple(self._camera.target)
                    client.camera.up_direction = tuple(self._camera.up)

    def _send(self, now: float) -> None:
        """Send what moved, not more often than the rates say."""
        known = (
            tuple(body.uid for body in self._world.bodies),
            tuple(id(part) for skin in self._world.skins for part in (skin, skin.faces)),
            tuple(id(part) for lines in self._world.lines for part in (lines, lines.starts)),
        )
        if known != self._known:
            self._known = known
            self._build()
        if now - self._sent_poses >= 1 / POSE_RATE:
            self._sent_poses = now
            self._send_poses()
        if now - self._sent_skins >= 1 / SKIN_RATE:
            self._sent_skins = now
            self._clock.value = f"{self._world.time:.1f}"
            for skin, pieces in self._surfaces:
                vertices = skin.vertices()
                with self._server.atomic():
                    for piece, handle in pieces:
                        handle.vertices = vertices[piece.source]
            with self._server.atomic():
                for lines, ends, handle in self._strokes:
                    handle.points, handle.colors = lines.points()[ends], lines.colors()[ends]

    def _build(self) -> None:
        """Make a node for each shape and each piece of a skin."""
        scene = self._server.scene
        skins = [handle for _, pieces in self._surfaces for _, handle in pieces]
        others = [made[-1] for made in (*self._nodes, *self._strokes)]
        for handle in (*others, *skins):
            handle.remove()
        self._nodes, self._surfaces, self._strokes = [], [], []
        parts = world_parts(self._world)
        floors = [part for part in parts if part.is_floor]
        if len(floors) == 1:  # the page's own floor goes on to the horizon
            parts.remove(floors[0])
            self._grid.position = (0.0, 0.0, floors[0].top - 0.001)
            red, green, blue, _ = floors[0].rgba[0].tolist()
            self._grid.plane_color = (red, green, blue)
        for number, part in enumerate(parts):
            pieces = split_by_color(part.mesh.faces, part.rgba[:, :3], at_most=8)
            for color, piece in enumerate(pieces):
                handle = scene.add_mesh_simple(
                    f"/bodies/{part.body.name}/{number}_{color}",
                    part.mesh.vertices[piece.source],
                    piece.faces,
                    color=piece.rgb,
                    opacity=part.alpha if part.alpha < 0.99 else None,
                    side="front" if part.mesh.closed else "double",
                )
                self._nodes.append((part.body, part.shape.link, part.shape.pose, handle))
        self._add_skins()
        self._add_lines()
        self._sent_poses = self._sent_skins = -math.inf

    def _add_lines(self) -> None:
        add = self._server.scene.add_line_segments
        has_metres = "thickness" in inspect.signature(add).parameters  # since viser 1.1
        for number, lines in enumerate(self._world.lines):
            ends = segments(lines.starts)
            width = 2 * float(np.median(lines.radii))
            size = {"thickness": width} if has_metres else {"line_width": _LINE_WIDTH}
            handle = add(f"/lines/{number}", lines.points()[ends], lines.colors()[ends], **size)
            self._strokes.append((lines, ends, handle))

    def _add_skins(self) -> None:
        for number, skin in enumerate(self._world.skins):
            opacity = skin_opacity(skin)
            if not opacity:
                continue
            vertices = skin.vertices()
            made: list[tuple[Piece, Any]] = []
            for piece in split_by_color(skin.faces, skin.colors[:, :3], at_most=10):
                handle = self._server.scene.add_mesh_simple(
                    f"/skins/{number}/{len(made)}",
                    vertices[piece.source],
                    piece.faces,
                    color=piece.rgb,
                    opacity=opacity if opacity < 1 else None,
                    side="double",
                )
                made.append((piece, handle))
            self._surfaces.append((skin, made))

    def _send_poses(self) -> None:
        poses: dict[int, Any] = {}
        with self._server.atomic():
            for body, link, local, handle in self._nodes:
                if body.uid not in poses:
                    poses[body.uid] = body.link_poses()
                position, turn = (row[link + 1] for row in poses[body.uid])
                at = Pose(tuple(position), tuple(turn)) @ local
                x, y, z, w = at.quaternion
                handle.position, handle.wxyz = at.position, (w, x, y, z)

    def _pace(self) -> None:
        """Wait until the wall clock has caught up with the simulated one."""
        now, simulated, speed = time.monotonic(), self._world.time, float(self._speed.value)
        wall, start, old_speed = self._anchor
        ahead = (simulated - start) / speed - (now - wall)
        # A rewind, a pause, a new speed or a slow computer: start to count anew.
        if simulated < self._last_simulated or speed != old_speed or ahead < -_LONGEST_PAUSE:
            self._anchor = (now, simulated, speed)
        elif ahead > 0:
            time.sleep(ahead)
        self._last_simulated = simulated


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep viser from printing: where the page is, the log says."""
    import rich  # viser needs it

    console = rich.get_console()
    before, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = before


def _free_port(host: str) -> int:
    with socket.socket() as probe:
        probe.bind((host, 0))
        return int(probe.getsockname()[1])
