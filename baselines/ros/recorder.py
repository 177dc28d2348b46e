"""Writes what is told on topics to an MCAP file, as for Foxglove. Imports ROS: see docs/ros.md.

Messages stay as they come over the wire (CDR), beside their definitions, as `ros2 bag` has them:
https://mcap.dev/spec/registry.
"""

from __future__ import annotations

import re
import time
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import rclpy
from mcap.writer import Writer
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions

FOUND = 10.0  # [s] within which a robot must be found; our own choice
LOOK = 0.5  # [s] between looks for new topics; our own choice
FIELD = re.compile(r"^([A-Za-z]\w*(?:/\w+)?)\b(?!\s*=)", re.MULTILINE)
BETWEEN = "\n" + "=" * 80 + "\nMSG: {}\n"


def definition(kind: str) -> str:
    """Return the definition of a message such as `sensor_msgs/msg/JointState`, all of its parts after it."""
    known: dict[str, str] = {}

    def take(name: str) -> None:
        package, plain = name.split("/")
        home, end = import_module(package).__file__, Path("share", package, "msg", f"{plain}.msg")
        found = [each / end for each in Path(str(home)).parents if (each / end).is_file()]
        text = known[name] = found[0].read_text("utf-8")
        for part in FIELD.findall(text):
            full = part if "/" in part else f"{package}/{part}"
            if full not in known and (part[0].isupper() or "/" in part):
                take(full)

    first = kind.replace("/msg/", "/")
    take(first)
    return known.pop(first) + "".join(BETWEEN.format(name) + text for name, text in known.items())


def _message(kind: str) -> Any:
    """Return the class of a message such as `sensor_msgs/msg/JointState`."""
    package, *_, name = kind.split("/")
    return getattr(import_module(f"{package}.msg"), name)


class _Recorder(Node):
    """Takes down all topics of a namespace, `/tf` and `/clock`, new ones as they come."""

    def __init__(self, writer: Writer, namespace: str) -> None:
        super().__init__("rcare_marl_recorder", namespace=namespace)
        self.counts: dict[str, int] = {}
        self.first: float | None = (
            None  # when something was first told, by a clock that only rises [s]
        )
        self._writer, self._kinds = writer, dict[str, int]()
        self.create_timer(LOOK, self._look)
        self._look()

    def _look(self) -> None:
        own = self.get_namespace().rstrip("/") + "/"
        for topic, (kind, *_) in self.get_topic_names_and_types():
            is_wanted = topic.startswith(own) or topic in ("/tf", "/clock")
            if topic in self.counts or not is_wanted or "/msg/" not in kind:  # parts of actions
                continue
            if kind not in self._kinds:
                told = definition(kind).encode()
                self._kinds[kind] = self._writer.register_schema(kind, "ros2msg", told)
            channel = self._writer.register_channel(topic, "cdr", self._kinds[kind])
            self.counts[topic] = 0
            latched = any(
                each.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
                for each in self.get_publishers_info_by_topic(topic)
            )
            keep = DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
            profile = QoSProfile(depth=100, durability=keep)
            take = partial(self._take, topic, channel)
            self.create_subscription(_message(kind), topic, take, profile, raw=True)

    def _take(self, topic: str, channel: int, message: bytes) -> None:
        if self.first is None and topic.endswith(("/joint_states", "/scene")):
            self.first = time.monotonic()
        now = self.get_clock().now().nanoseconds
        self._writer.add_message(channel, now, bytes(message), now, self.counts[topic])
        self.counts[topic] += 1


def record(path: Path, namespace: str = "", seconds: float = 0.0) -> dict[str, int]:
    """Write all that is told until Ctrl-C; return how many messages of each topic.

    Args:
        path: The file.
        namespace: Of the robot; empty for all topics.
        seconds: How long from the first scene or joints on [s]; 0 goes on.
    """
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    executor = SingleThreadedExecutor()
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library="rcare-marl")
        node = _Recorder(writer, namespace)
        executor.add_node(node)
        until = time.monotonic() + FOUND + seconds
        try:
            while not seconds or time.monotonic() < until:
                executor.spin_once(timeout_sec=0.1)
                if node.first is not None:
                    until = node.first + seconds
        except KeyboardInterrupt:  # the way to end it
            pass
        finally:
            executor.shutdown()
            rclpy.shutdown()
            writer.finish()  # type: ignore[no-untyped-call]
    return node.counts
