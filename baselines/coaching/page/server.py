"""The server of the page: its files, and one websocket a session. Who may ask, its `Door` knows."""

from __future__ import annotations

import asyncio
import base64
import hashlib
import json
import logging
import re
import secrets
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from aiohttp import WSCloseCode, WSMsgType, web

from rcare_marl.agents.coaching.exercise import Exercise, load_exercises
from rcare_marl.errors import RcareError
from rcare_marl.own_host import is_loopback as is_loopback

from ...pages.door import HEADERS, TOKEN, Door, Limiter, answer
from ...pages.door import secured as secured
from .clinician import OBSERVATIONS, TABLE
from .editor import drafted, fields_of
from .message import LARGEST, MISTAKES, Draft, Message, MessageError, parse
from .packages import FILES, WEB
from .recording import REPORT, STYLE, Recorder
from .room import STEP, Room

PAGE = tuple(file.name for end in ("css", "js") for file in sorted(WEB.glob(f"*.{end}")))
KEPT = (REPORT, TABLE, OBSERVATIONS)  # of a recording, what the page hands out
SESSION = re.compile(r"session-[0-9-]+")
# The report has its own looks in itself, and is opened by the page: these, and no others, may be so.
LOOKS = f"'sha256-{base64.b64encode(hashlib.sha256(STYLE.encode()).digest()).decode()}'"
ROOMS = 8  # sessions at once; our own choice
CLOSED_ABOVE = 64 * LARGEST  # a websocket that sends more at once is closed [bytes]
SILENT = 20.0  # between two signs of life that are asked of the page [s]
logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Service:
    """What the server offers.

    Attributes:
        packages: The folder `node_modules` with what the page takes from npm.
        record: Folder for recordings; None switches recording off.
        exercises: What is on offer.
        host: Address that is bound.
        is_secure: Whether it is served by HTTPS.
        token: What a page has to know; random if left out.
        clock: Time of sessions [s], which only grows.
    """

    packages: Path
    record: Path | None = None
    exercises: Sequence[Exercise] = field(default_factory=load_exercises)
    host: str = "127.0.0.1"
    is_secure: bool = False
    token: str = field(default_factory=lambda: secrets.token_urlsafe(TOKEN), repr=False)
    clock: Callable[[], float] = time.monotonic


class Server(Door):
    """Serves the page and its sessions."""

    # The page may ask for the webcam, and compile MediaPipe, which is WebAssembly.
    headers: Mapping[str, str] = {
        key: value.replace("camera=()", "camera=(self)")
        .replace("script-src 'self'", "script-src 'self' 'wasm-unsafe-eval'")
        .replace("style-src 'self'", f"style-src 'self' {LOOKS}")
        for key, value in HEADERS.items()
    }

    def __init__(self, service: Service) -> None:
        super().__init__(service.host, service.token, is_secure=service.is_secure)
        self._service, self._rooms = service, 0
        self._sockets: set[web.WebSocketResponse] = set()
        self.app.router.add_get("/", self._index)
        self.app.router.add_get("/editor", self._editor)
        self.app.router.add_get("/setting", self._setting)
        self.app.router.add_get("/session", self._session)
        self.app.router.add_get("/kept/{session}/{name}", self._kept)
        self.app.router.add_get("/web/{name}", self._file)
        self.app.router.add_get("/package/{package}/{name}", self._of_package)
        self.app.on_shutdown.append(self._leave)

    async def _index(self, _: web.Request) -> web.StreamResponse:
        return answer(WEB / "index.html")

    async def _editor(self, _: web.Request) -> web.StreamResponse:
        return answer(WEB / "editor.html")

    async def _file(self, request: web.Request) -> web.StreamResponse:
        name = request.match_info["name"]
        if name not in PAGE:
            raise web.HTTPNotFound
        return answer(WEB / name)

    async def _of_package(self, request: web.Request) -> web.StreamResponse:
        folder, names = FILES.get(request.match_info["package"], ("", ()))
        name = request.match_info["name"]
        if name not in names:
            raise web.HTTPNotFound
        return answer(self._service.packages / folder / name)

    async def _setting(self, request: web.Request) -> web.StreamResponse:
        """What the page offers, and the token for all that follows."""
        self.check_token(request, takes_ticket=True)
        record = self._service.record
        return web.json_response(
            {
                "exercises": [
                    {"name": each.name, **fields_of(each)} for each in self._service.exercises
                ],
                "mistakes": list(MISTAKES),
                "record": None if record is None else str(record),
                "token": self._service.token,
            }
        )

    async def _kept(self, request: web.Request) -> web.StreamResponse:
        """What was recorded of a session, for who has the token."""
        self.check_token(request)
        record, match = self._service.record, request.match_info
        if record is None or not SESSION.fullmatch(match["session"]) or match["name"] not in KEPT:
            raise web.HTTPNotFound
        file = record / match["session"] / match["name"]
        if not file.is_file():
            raise web.HTTPNotFound
        return answer(file)

    async def _session(self, request: web.Request) -> web.StreamResponse:
        self.check_origin(request)
        self.check_token(request)
        if self._rooms >= ROOMS:
            raise web.HTTPServiceUnavailable(text=f"no more than {ROOMS} sessions at once")
        self._rooms += 1
        socket = web.WebSocketResponse(
            max_msg_size=CLOSED_ABOVE, compress=False, heartbeat=SILENT, timeout=2.0
        )
        try:
            await socket.prepare(request)
            self._sockets.add(socket)
            await Conversation(socket, self._service).hold()
        finally:
            self._sockets.discard(socket)
            self._rooms -= 1
        return socket

    async def _leave(self, _: web.Application) -> None:
        for socket in tuple(self._sockets):
            await socket.close()


class Conversation:
    """One page and its room, until the page goes."""

    def __init__(self, socket: web.WebSocketResponse, service: Service) -> None:
        recorder = None if service.record is None else Recorder(service.record)
        self._socket, self._limiter = socket, Limiter()
        # Neither answers nor log become a flood themselves.
        self._complaints, self._notes = Limiter(rate=1, burst=1), Limiter(rate=5, burst=20)
        self._room = Room(recorder=recorder, exercises=service.exercises)
        self._clock = service.clock

    async def hold(self) -> None:
        """Listen and tell, side by side."""
        telling = asyncio.create_task(self._tell())
        try:
            async for item in self._socket:
                now = time.monotonic()
                if not self._limiter.lets(now):
                    if self._complaints.lets(now):
                        await self._refuse("too many messages; those beyond are dropped")
                    continue
                await self._take(item.type, item.data)
        finally:
            telling.cancel()
            await asyncio.gather(telling, return_exceptions=True)
            await self._write()

    async def _take(self, kind: WSMsgType, data: object) -> None:
        message: Message | None = None
        try:
            if kind is not WSMsgType.TEXT or not isinstance(data, str):
                raise MessageError("messages are text")
            message = parse(data)
            if isinstance(message, Draft):
                await self._send(drafted(message))
            else:
                self._room.receive(message, self._clock())
        except RcareError as error:
            await self._refuse(str(error), message)

    async def _refuse(self, why: str, message: Message | None = None) -> None:
        if self._notes.lets(time.monotonic()):
            logger.warning("refused a message: %s", why)
        what = "" if message is None else type(message).__name__.lower()
        await self._send({"type": "refused", "what": what, "why": why})

    async def _tell(self) -> None:
        """Send what the page shows; a fault of ours ends the conversation, and is not hidden."""
        try:
            await self._tell_on()
        except Exception:
            logger.exception("a session broke off")
            await self._socket.close(code=WSCloseCode.INTERNAL_ERROR)

    async def _tell_on(self) -> None:
        """Tell 30 times a second while a session is on, else four times."""
        due = time.monotonic()
        while not self._socket.closed:
            await self._send(self._room.step(self._clock()))
            if not self._room.is_on:
                await self._write()
            due = max(due + (STEP if self._room.is_on else 0.25), time.monotonic() + 0.005)
            await asyncio.sleep(due - time.monotonic())

    async def _write(self) -> None:
        """Write the recording of a session that is over, if there is one."""
        recorder = self._room.recorder
        recording = None if recorder is None else recorder.take()
        if recorder is None or recording is None:
            return
        try:
            report = await asyncio.to_thread(recording.write, recorder.folder)
        except RcareError as error:
            logger.error("%s", error)
            await self._send({"type": "refused", "why": str(error)})
            return
        recorder.written(report)

    async def _send(self, data: dict[str, object]) -> None:
        if not self._socket.closed:
            try:
                await self._socket.send_str(json.dumps(data, allow_nan=False))
            except ConnectionError:
                logger.info("the page went while it was being told")
