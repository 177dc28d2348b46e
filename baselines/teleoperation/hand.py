"""A hand without a browser: it says to the page's server what a page would, by a law of what it is told."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from aiohttp import ClientSession, WSMsgType

from rcare_marl.pose import Array

Seen = Mapping[str, Sequence[float]]
Law = Callable[[Seen], Sequence[float]]  # what is observed, by name, to the values of an action

# All our own choices, of the law that feeds.
SPEED, TURN = 0.25, 1.0  # that the value 1 means [m/s], [rad/s]
GAIN, TURN_GAIN = 2.5, 2.0  # [1/s]
FAST, SLOW, NEAR = 0.18, 0.06, 0.12  # [m/s], [m/s], [m]
WAIT = 0.09  # [m] from the mouth, until it opens
OPEN = 0.18  # [rad]


def feed(seen: Seen) -> list[float]:
    """Move a spoon as a hand would: keep it level, stop before the face, go in when the mouth opens."""
    way, up = np.array(seen["bowl_to_mouth"]), np.array(seen["bowl_up"])
    face = np.array(seen["face_direction"])
    away = 0.0 if seen["jaw_opening"][0] > OPEN else WAIT
    goal = way + away * face
    fastest = SLOW if np.linalg.norm(way) < NEAR else FAST
    velocity = GAIN * goal
    velocity *= min(1.0, fastest / max(float(np.linalg.norm(velocity)), 1e-9))
    spin: Array = TURN_GAIN * np.cross(up, (0.0, 0.0, 1.0))
    return [*np.clip(velocity / SPEED, -1, 1).tolist(), *np.clip(spin / TURN, -1, 1).tolist()]


async def play(
    address: str,
    token: str,
    role: str,
    law: Law,
    *,
    episodes: int,
    noise: float = 0.0,
    seed: int = 0,
) -> list[bool]:
    """Play episodes by a law, and return which succeeded.

    Args:
        address: Of the page, such as `http://127.0.0.1:8765`.
        token: Of the page.
        role: What to play.
        law: From what is observed to an action.
        episodes: How many.
        noise: Standard deviation of how a hand shakes, of an action.
        seed: Of that.

    Raises:
        ConnectionError: If the server ends it before all were played.
    """
    rng, done = np.random.default_rng(seed), list[bool]()
    query = {"token": token, "role": role, "draws": "nothing"}
    async with (
        ClientSession() as session,
        session.ws_connect(f"{address}/session", params=query, origin=address) as socket,
    ):
        answered = -1
        async for item in socket:
            if item.type is not WSMsgType.TEXT:
                continue
            told: dict[str, Any] = json.loads(item.data)
            if told["type"] != "scene" or told["number"] <= answered:
                continue
            answered = told["number"]
            if told["is_over"]:
                done.append(told["success"])
                if len(done) == episodes:
                    return done
                await socket.send_json({"type": "command", "wish": "reset"})
                continue
            values = np.array(law(told["seen"]))
            values = np.clip(values + noise * rng.standard_normal(len(values)), -1, 1)
            hand = {"type": "hand", "seen": answered, "clutch": True, "values": values.tolist()}
            await socket.send_json(hand)
    raise ConnectionError(f"the server ended it after {len(done)} of {episodes} episodes")
