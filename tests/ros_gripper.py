"""A plain client of GripperCommand, rclpy and messages alone: ros_gripper.py ACTION POSITION."""

import sys

import rclpy
from control_msgs.action import GripperCommand
from rclpy.action import ActionClient

rclpy.init()
node = rclpy.create_node("plain_gripper")
client = ActionClient(node, GripperCommand, sys.argv[1])
assert client.wait_for_server(30.0), "no such action"
goal = GripperCommand.Goal()
goal.command.position = float(sys.argv[2])
sent = client.send_goal_async(goal)
rclpy.spin_until_future_complete(node, sent)
assert sent.result().accepted, "refused"
done = sent.result().get_result_async()
rclpy.spin_until_future_complete(node, done)
result = done.result().result
print(
    f"reached {result.reached_goal} stalled {result.stalled} at {result.position:.3f}", flush=True
)
node.destroy_node()
rclpy.shutdown()
