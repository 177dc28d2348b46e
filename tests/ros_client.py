"""A plain client of FollowJointTrajectory: rclpy and messages alone, nothing of rcare-marl.

ros_client.py TOPIC_OF_JOINTS ACTION JOINT=CHANGE...: moves joints by so much [rad] in 2 s; prints how far
they are off then.
"""

import sys

import rclpy
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionClient
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectoryPoint

rclpy.init()
node = rclpy.create_node("plain_client")
latest: dict[str, float] = {}
node.create_subscription(
    JointState, sys.argv[1], lambda m: latest.update(zip(m.name, m.position, strict=True)), 10
)
client = ActionClient(node, FollowJointTrajectory, sys.argv[2])
assert client.wait_for_server(30.0), "no such action"
while not latest:
    rclpy.spin_once(node, timeout_sec=0.1)
changes = dict(each.split("=") for each in sys.argv[3:])
goal = FollowJointTrajectory.Goal()
goal.trajectory.joint_names = list(changes)
point = JointTrajectoryPoint()
wanted = {name: latest[name] + float(change) for name, change in changes.items()}
point.positions = list(wanted.values())
point.time_from_start.sec = 2
goal.trajectory.points = [point]
sent = client.send_goal_async(goal)
rclpy.spin_until_future_complete(node, sent)
assert sent.result().accepted, "refused"
done = sent.result().get_result_async()
rclpy.spin_until_future_complete(node, done)
result = done.result().result
for _ in range(5):
    rclpy.spin_once(node, timeout_sec=0.1)
off = max(abs(latest[name] - wanted[name]) for name in wanted)
print(f"code {result.error_code} {result.error_string} off {off:.4f}", flush=True)
node.destroy_node()
rclpy.shutdown()
