"""The server of the page: one websocket for each role that a person plays, and one scene for all."""

from __future__ import annotations

import asyncio
import json
import logging
import math
import secrets
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from aiohttp import WSMsgType, web

from rcare_marl.errors import RcareError

from ..pages.door import TOKEN, Door, Limiter, answer
from ..pages.strict import LARGEST, MessageError
from .stage import (
    AUDIENCE,
    QUIET,
    Choice,
    Hand,
    Message,
    Pace,
    Scenario,
    Stage,
    choices,
    parse,
)
from .tracked import Tracked

WEB = Path(__file__).parent / "web"
THREE = ("three.module.js", "three.core.js")  # the first imports the second
PAGE = ("style.css", "page.js", "scene.js", "headset.js", "audience.js")
DRAWS = ("fine", "coarse", "nothing")  # shapes that a page may ask for
IDLE = 0.25  # between two scenes that are told while nothing moves [s]
SILENT = 20.0  # between two signs of life that are asked of the page [s]
LINGER = 1.5  # at the end of an episode that is watched [s]
MOST_WAITED = 2.0  # for a hand, where the scene waits for hands [s]

logger = logging.getLogger(__name__)
T = TypeVar("T")


@dataclass
class Player:
    """A person at a page.

    Attributes:
        role: What they play.
        socket: Their page.
        draws: What their page draws: `fine` shapes, `coarse` ones without a graphics card, or `nothing`.
        hand: What their hand did last.
        at: When [s].
        is_told: Whether their page knows the scene.
        latency: From the scene that a hand saw to what it did, as it came here [s].
    """

    role: str
    socket: web.WebSocketResponse
    draws: str
    hand: Hand | Tracked | None = None
    at: float = 0.0
    is_told: bool = False
    latency: float = 0.0
    sent: dict[int, float] = field(default_factory=dict)
    drawn: int = -1  # the scene that its page draws
    known: tuple[int, ...] = ()  # versions of the shapes that it has

    def live(self, now: float) -> Hand | Tracked | None:
        """Return what the hand does; nothing where it fell silent."""
        return self.hand if now - self.at < QUIET else None


class Server(Door):
    """Serves the page and the scene.

    Attributes:
        players: Who plays, by role; and who watches, by a number.
        done: Is set when all episodes were played.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        host: str = "127.0.0.1",
        speed: float = 1.0,
        waits: bool = False,
        token: str | None = None,
        three: Path | None = None,
        episodes: int = 0,
        told: Callable[[str], None] = logger.info,
    ) -> None:
        """Prepare; the scene is built when the application starts.

        Args:
            scenario: What is played.
            host: Address that is bound.
            speed: Simulated over real time.
            waits: Whether each step waits until every hand answered the scene before it.
            token: What a page has to know; random if None.
            three: Folder with the files of three.js; without it no page is drawn, for hands of programs.
            episodes: After how many `done` is set; 0 goes on for good.
            told: Is told what came of each episode.
        """
        super().__init__(host, token or secrets.token_urlsafe(TOKEN))
        self._scenario, self._speed, self._waits = scenario, speed, waits
        self._three = three
        self._thread = ThreadPoolExecutor(1)  # the scene is of one thread
        self.players: dict[str, Player] = {}
        self._paused, self._running, self._over = False, False, 0.0
        self._told, self._left = told, episodes or math.inf
        self.done = asyncio.Event()
        self._moved = asyncio.Event()
        self._telling = asyncio.Lock()  # nobody is told of two scenes at once
        self.app.router.add_get("/", self._index)
        self.app.router.add_get("/web/{name}", self._file)
        self.app.router.add_get("/three/{name}", self._file)
        self.app.router.add_get("/setting", self._setting)
        self.app.router.add_get("/session", self._session)
        self.app.cleanup_ctx.append(self._play)

    async def _on_stage(self, do: Callable[..., T], *args: Any) -> T:
        return await asyncio.get_running_loop().run_in_executor(self._thread, do, *args)

    async def _play(self, _: web.Application) -> Any:
        self._stage: Stage = await self._on_stage(Stage, self._scenario)
        loop = asyncio.create_task(self._loop())
        yield
        loop.cancel()
        await asyncio.gather(loop, return_exceptions=True)
        for player in tuple(self.players.values()):
            await player.socket.close()
        await self._on_stage(self._stage.close)
        self._thread.shutdown()

    async def _index(self, _: web.Request) -> web.StreamResponse:
        return answer(WEB / "index.html")

    async def _file(self, request: web.Request) -> web.StreamResponse:
        name, is_three = request.match_info["name"], request.path.startswith("/three/")
        folder = self._three if is_three else WEB
        if folder is None or name not in (THREE if is_three else PAGE):
            raise web.HTTPNotFound
        return answer(folder / name)

    async def _setting(self, request: web.Request) -> web.StreamResponse:
        """What the page offers, and the token for all that follows."""
        self.check_token(request, takes_ticket=True)
        roles = {role: role not in self.players for role in self._stage.roles or (AUDIENCE,)}
        data = {"task": self._scenario.task, "roles": roles, "token": self.token}
        if not self._stage.roles and not self._stage.is_replay:
            data["choices"] = await asyncio.to_thread(choices)
        return web.json_response(data)

    async def _session(self, request: web.Request) -> web.StreamResponse:
        self.check_origin(request)
        self.check_token(request)
        role = request.query.get("role", "")
        if (draws := request.query.get("draws", "fine")) not in DRAWS:
            raise web.HTTPBadRequest(text=f"a page draws {', '.join(DRAWS)}")
        watches = role == AUDIENCE and not self._stage.roles
        if not watches and (role not in self._stage.roles or role in self.players):
            raise web.HTTPConflict(text="no person can play that role, or somebody does")
        socket = web.WebSocketResponse(
            max_msg_size=4 * LARGEST, compress=False, heartbeat=SILENT, timeout=2.0
        )
        player = Player(role, socket, draws=draws)
        key = f"{AUDIENCE} {secrets.token_hex(4)}" if watches else role
        self.players[key] = player
        try:
            await socket.prepare(request)
            if self._stage.is_replay:  # a page has all of it, whenever it comes
                self._running = False
                await self._on_stage(self._stage.again)
            await self._send(player, {"type": "facts", **self._stage.facts(role)})
            await self._tell(player)
            player.is_told = True
            self._moved.set()
            await self._listen(player)
        finally:
            del self.players[key]
            self._moved.set()
        return socket

    async def _listen(self, player: Player) -> None:
        limiter, complaints = Limiter(), Limiter(rate=5, burst=30)
        async for item in player.socket:
            now = time.monotonic()
            if not self._waits and not limiter.lets(now):
                continue
            try:
                if item.type is not WSMsgType.TEXT:
                    raise MessageError("messages are text")
                await self._take(player, parse(item.data), now)
            except RcareError as error:
                if complaints.lets(now):
                    logger.warning("refused a message: %s", error)
                    await self._send(player, {"type": "refused", "why": str(error)})

    async def _take(self, player: Player, message: Message, now: float) -> None:
        if isinstance(message, Hand | Tracked):
            self._stage.check(player.role, message)
            player.hand, player.at = message, now
            if message.seen in player.sent:
                player.latency = now - player.sent[message.seen]
        elif isinstance(message, Pace):
            self._speed = message.speed
        elif isinstance(message, Choice):
            await self._change(message)
        elif message.wish in ("pause", "go"):
            self._paused = message.wish == "pause"
        else:
            self._running = False
            do = self._stage.mark if message.wish == "success" else self._stage.begin
            await self._on_stage(do)
            await self._tell_all()
        self._moved.set()

    async def _change(self, choice: Choice) -> None:
        """Show another scene in place of this one; where it cannot be, this one goes on."""
        if self._stage.roles or self._stage.is_replay or self._scenario.record is not None:
            raise MessageError("the scene is chosen where all watch and nothing is recorded")
        new = await self._on_stage(lambda: Stage(choice.of()))
        async with self._telling:
            old, self._stage, self._running = self._stage, new, False
            await self._on_stage(old.close)
            for player in tuple(self.players.values()):
                player.drawn = -1
                facts = await self._on_stage(new.facts, player.role)
                await self._send(player, {"type": "facts", **facts})
        await self._tell_all()

    def _status(self) -> str:
        told = sum(player.is_told for player in self.players.values())
        late = self._stage.is_replay and told < len(self.players)
        if late or told < max(len(self._stage.roles), 1):
            return "waiting"
        if self._paused:
            return "paused"
        if self._stage.is_over:
            return "over"
        return "running" if self._running else "ready"

    async def _loop(self) -> None:
        """Step while all roles are played, none has paused, and somebody has begun; a fault ends the page."""
        try:
            due = time.monotonic()
            while True:
                self._moved.clear()
                if self._status() == "ready":  # the first hand that moves begins
                    live = [player.live(time.monotonic()) for player in self.players.values()]
                    begun = any(hand is not None and hand.clutch for hand in live)
                    self._running = begun or not self._stage.roles
                if self._status() != "running":
                    await self._rest()
                    await self._go_on()
                    due = time.monotonic()
                    continue
                if self._waits and self._stage.roles:
                    await self._answered()
                now = time.monotonic()
                hands = {role: player.live(now) for role, player in self.players.items()}
                await self._on_stage(self._stage.step, hands)
                self._running = not self._stage.is_over
                if self._stage.is_over:
                    self._end()
                await self._tell_all()
                due = max(due + self._stage.control_dt / self._speed, time.monotonic() - IDLE)
                hurries = self._waits or self._stage.is_replay  # the page has its own pace then
                await asyncio.sleep(0 if hurries else max(due - time.monotonic(), 0))
        except Exception:
            logger.exception("the scene broke off")
            for player in tuple(self.players.values()):
                await player.socket.close(code=1011)
            raise

    def _end(self) -> None:
        """Say what came of an episode."""
        self._over = time.monotonic()
        self._told(self._stage.outcome())
        self._left -= 1
        if self._left <= 0:
            self.done.set()

    async def _go_on(self) -> None:
        """Begin the next episode where all watch, when they have seen how the last one ended."""
        watched = not self._stage.roles and not self._stage.is_replay
        if self._status() == "over" and watched and not self._paused:
            if time.monotonic() - self._over > LINGER and not self.done.is_set():
                await self._on_stage(self._stage.begin)

    async def _rest(self) -> None:
        """Wait until something is said, and tell how it stands now and then."""
        try:
            await asyncio.wait_for(self._moved.wait(), IDLE)
        except asyncio.TimeoutError:
            await self._tell_all()

    async def _answered(self) -> None:
        """Wait until each hand has answered the present scene, but not for long."""
        end = time.monotonic() + MOST_WAITED
        while any(
            player.hand is None or player.hand.seen < self._stage.number
            for player in self.players.values()
        ):
            self._moved.clear()
            try:
                await asyncio.wait_for(self._moved.wait(), max(end - time.monotonic(), 0.001))
            except asyncio.TimeoutError:
                return

    async def _tell_all(self) -> None:
        for player in tuple(self.players.values()):
            if player.is_told:
                await self._tell(player)

    async def _tell(self, player: Player) -> None:
        async with self._telling:
            facts = await self._on_stage(self._stage.seen, player.role)
            player.sent = {k: v for k, v in player.sent.items() if k > facts["number"] - 20}
            player.sent.setdefault(facts["number"], time.monotonic())
            missing = [role for role in self._stage.roles if role not in self.players]
            state = {
                "status": self._status(),
                "missing": missing,
                "latency_ms": 1e3 * player.latency,
            }
            await self._send(player, {"type": "scene", **facts, **state})
            if player.draws != "nothing" and player.drawn != facts["number"]:
                draw = partial(self._stage.drawn, is_coarse=player.draws == "coarse")
                messages, known = await self._on_stage(draw, player.known)
                for data in messages:
                    if not player.socket.closed:
                        await self._deliver(player.socket.send_bytes(data))
                player.drawn, player.known = facts["number"], known

    async def _send(self, player: Player, data: dict[str, Any]) -> None:
        if not player.socket.closed:
            await self._deliver(player.socket.send_str(json.dumps(data, allow_nan=False)))

    async def _deliver(self, sending: Any) -> None:
        try:
            await sending
        except ConnectionError:
            logger.info("a page went while it was being told")
