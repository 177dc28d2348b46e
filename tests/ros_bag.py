"""Reads an MCAP file as others do, with its own definitions' names and ROS's own decoder; prints JSON."""

import json
import sys
from importlib import import_module
from typing import Any

from mcap.reader import make_reader
from rclpy.serialization import deserialize_message

counts: dict[str, int] = {}
joints: list[str] = []
with open(sys.argv[1], "rb") as stream:
    for schema, channel, message in make_reader(stream).iter_messages():
        assert schema is not None and schema.encoding == "ros2msg" and schema.data
        package, _, name = schema.name.split("/")
        told: Any = deserialize_message(
            message.data, getattr(import_module(f"{package}.msg"), name)
        )
        counts[channel.topic] = counts.get(channel.topic, 0) + 1
        if name == "JointState":
            joints = list(told.name)
print(json.dumps({"counts": counts, "joints": joints}))
