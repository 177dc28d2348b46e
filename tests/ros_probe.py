"""Listens to all that a served robot tells, stops and releases it, and prints what came as JSON."""

import json
import sys
import time
from typing import Any

import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image, JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

rclpy.init()
node = rclpy.create_node("probe")
got: dict[str, list[Any]] = {}
latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
TOPICS: dict[str, Any] = {
    "joint_states": JointState,
    "wrench": WrenchStamped,
    "scene": String,
    "people": MarkerArray,
    "/tf": TFMessage,
    "/clock": Clock,
    "camera/wrist/image_raw": Image,
    "camera/wrist/camera_info": CameraInfo,
}
space = sys.argv[1]
for name, kind in TOPICS.items():
    topic = name if name.startswith("/") else f"{space}/{name}"
    node.create_subscription(kind, topic, lambda m, n=name: got.setdefault(n, []).append(m), 10)
for name in ("robot_description", "episode"):
    node.create_subscription(
        String, f"{space}/{name}", lambda m, n=name: got.setdefault(n, []).append(m), latched
    )
stop = node.create_client(SetBool, f"{space}/emergency_stop")
end = time.monotonic() + 20.0
while time.monotonic() < end and len(got) < len(TOPICS) + 2:
    rclpy.spin_once(node, timeout_sec=0.1)
answers = []
for is_stopped in (True, False):
    stop.wait_for_service(5.0)
    asked = stop.call_async(SetBool.Request(data=is_stopped))
    rclpy.spin_until_future_complete(node, asked, timeout_sec=5.0)
    answers.append(asked.result().message)
print(
    json.dumps(
        {
            "topics": sorted(got),
            "answers": answers,
            "joints": list(got["joint_states"][0].name),
            "urdf": got["robot_description"][0].data[:2000],
            "frames": [t.child_frame_id for t in got["/tf"][0].transforms],
            "picture": [
                got["camera/wrist/image_raw"][0].height,
                len(set(got["camera/wrist/image_raw"][0].data)),
            ],
            "focus": got["camera/wrist/camera_info"][0].k[0],
            "bones": len(got["people"][0].markers[0].points),
        }
    )
)
node.destroy_node()
rclpy.shutdown()
