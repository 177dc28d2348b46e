"""The node that serves an environment as a robot, in real time. Imports ROS: see docs/ros.md."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import rclpy
from control_msgs.action import FollowJointTrajectory, GripperCommand
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image, JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

from rcare_marl.agents.people.body.skeleton import JOINTS, PARENTS
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.sensing.camera import CameraSensor
from rcare_marl.console import print_line
from rcare_marl.errors import RcareError

from . import messages
from .pace import Pace, make_ready
from .served import ServedRobot
from .twin import account

TELLING = 2  # physics steps between messages of joints: 120 Hz
LAG = (
    0.1  # [s] that physics may lag behind real time before what is lost is given up; our own choice
)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
HEARD = 0.1  # [s] until who plays has heard that it pauses; our own choice
ANSWER = 5.0  # [s] that a call of `reset` waits; our own choice
SETTLING = 1.0  # [s] that joints get to arrive after the end of a trajectory; our own choice


class RobotNode(Node):
    """Serves a robot: what it senses on topics, and what moves it as topics, actions and services."""

    def __init__(self, served: ServedRobot, namespace: str = "", *, prefix: str = "") -> None:
        """Offer everything in a namespace, frames beginning with a prefix."""
        super().__init__("rcare_marl_robot", namespace=namespace)
        self.served, self._prefix = served, prefix
        self.is_awake = False  # whether anything that moves was told
        self.must_reset = False
        self.lock = threading.Lock()  # of the robot: what is told comes in threads of its own
        make = self.create_publisher
        self._joints = make(JointState, "joint_states", 10)
        self._wrench = make(WrenchStamped, "wrench", 10)
        self._scene = make(String, "scene", 10)
        self._markers = make(MarkerArray, "people", 10)
        self._frames, self._ticks = make(TFMessage, "/tf", 10), make(Clock, "/clock", 10)
        self._episode = make(String, "episode", LATCHED)
        make(String, "robot_description", LATCHED).publish(String(data=served.urdf()))
        self._cameras = self._make_cameras()
        together = ReentrantCallbackGroup()
        listen = self.create_subscription
        listen(TwistStamped, "servo/twist", self._on_twist, 10)
        listen(PoseStamped, "servo/pose", self._on_pose, 10)
        self.create_service(SetBool, "emergency_stop", self._on_stop)
        self.create_service(Trigger, "reset", self._on_reset, callback_group=together)
        arm = next(name for name in served.robot.moves if name in served.robot.arms)
        self._actions = [
            ActionServer(
                self,
                FollowJointTrajectory,
                f"{arm}_controller/follow_joint_trajectory",
                self._follow,
                goal_callback=self._may_move,
                cancel_callback=lambda _: CancelResponse.ACCEPT,
                callback_group=together,
            ),
            ActionServer(
                self,
                GripperCommand,
                f"{arm.removesuffix('arm')}gripper_controller/gripper_cmd",
                self._grip,
                goal_callback=self._may_grip,
                callback_group=together,
            ),
        ]

    def now(self) -> float:
        """Return the time of stamps [s]."""
        return float(self.get_clock().now().nanoseconds * 1e-9)

    def _make_cameras(self) -> dict[str, tuple[Any, Any, float]]:
        """Return what publishes each picture, with its field of view [degrees]."""
        suite, out = self.served.robot.sensors, {}
        arrays = [name for _, name, _ in self.served.env.describe_arrays("robot")]
        for name, sensor in ({} if suite is None else suite.sensors).items():
            if isinstance(sensor, CameraSensor) and "rgb" in sensor.config.outputs:
                key = next(each for each in arrays if each in (name, f"{name}_rgb"))
                topics = self.create_publisher(Image, f"camera/{name}/image_raw", 2)
                infos = self.create_publisher(CameraInfo, f"camera/{name}/camera_info", 2)
                out[key] = topics, infos, sensor.fov_deg
        return out

    def tell_joints(self) -> Any:
        """Publish where the joints are; return the stamp."""
        stamp, body = self.get_clock().now().to_msg(), self.served.robot.body
        names = list(body.joints)
        states = list(body.joint_readings([body.joints[name].index for name in names]))
        self._joints.publish(messages.joint_state(stamp, names, states))
        return stamp

    def tell(self) -> None:
        """Publish what the robot senses now; the scene last, since policies wait for it."""
        served, stamp = self.served, self.tell_joints()
        wrench = messages.wrench(stamp, f"{self._prefix}tool", served.wrench())
        wrench.header.frame_id = messages.WORLD
        self._wrench.publish(wrench)
        frames = served.frames()
        self._frames.publish(messages.transforms(stamp, frames, self._prefix))
        self._ticks.publish(Clock(clock=messages.moment(served.env.world.time)))
        for role, agent in served.env.cast.items():
            if isinstance(agent, Human):
                self._markers.publish(messages.bones(stamp, role, _bones(agent)))
        if self._cameras:
            seen = served.env.observe("robot")
            for name, (pictures, infos, fov) in self._cameras.items():
                pixels = seen[name]
                pictures.publish(messages.picture(stamp, name, pixels))
                infos.publish(messages.lens(stamp, name, pixels.shape, fov))
        told = {
            "stamp": messages.seconds(stamp),
            "separation": served.separation(),
            "state": account(served.env.task.state),
        }
        self._scene.publish(String(data=json.dumps(told)))

    def tell_episode(self, event: str) -> None:
        """Publish that an episode began, pauses or how it ended: until one begins nothing moves."""
        env = self.served.env
        told = {"event": event, "seed": env.seed, "success": self.served.outcomes.get(env.seed)}
        told["stamp"] = self.now()
        self._episode.publish(String(data=json.dumps(told)))

    def _on_twist(self, message: TwistStamped) -> None:
        twist = np.array(
            messages.vector(message.twist.linear) + messages.vector(message.twist.angular)
        )
        if not np.isfinite(twist).all():
            self.get_logger().error("a twist that is not finite stops the robot")
            self._stop(True)
            return
        with self.lock:
            self.is_awake = True
            if not self.served.is_stopped:
                self.served.tell_twist(twist)

    def _stop(self, is_stopped: bool) -> None:
        with self.lock:
            self.served.stop(is_stopped)

    def _on_pose(self, message: PoseStamped) -> None:
        pose = messages.pose_of(message.pose)
        if not np.isfinite((*pose.position, *pose.quaternion)).all():
            self.get_logger().error("a pose that is not finite stops the robot")
            self._stop(True)
            return
        with self.lock:
            self.is_awake = True
            if not self.served.is_stopped:
                self.served.tell_pose(pose)

    def _on_stop(self, request: Any, answer: Any) -> Any:
        self._stop(bool(request.data))
        answer.success, answer.message = True, "stopped" if request.data else "released"
        self.get_logger().warning(f"emergency stop: {answer.message}")
        return answer

    def _on_reset(self, _: Any, answer: Any) -> Any:
        self.must_reset = True
        until = time.monotonic() + ANSWER
        while self.must_reset and time.monotonic() < until:
            time.sleep(0.01)
        answer.success, answer.message = not self.must_reset, f"seed {self.served.env.seed}"
        return answer

    def _may_move(self, goal: Any) -> GoalResponse:
        if self.served.is_stopped:
            self.get_logger().error("stopped: no trajectory is taken")
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _follow(self, handle: Any) -> Any:
        told, out = handle.request.trajectory, FollowJointTrajectory.Result()
        try:
            times = np.array([messages.seconds(p.time_from_start) for p in told.points])
            positions = np.array([list(p.positions) for p in told.points], np.float64)
            with self.lock:
                self.served.tell_trajectory(list(told.joint_names), times, positions)
                own = self.served.trajectory
        except (RcareError, ValueError) as error:
            out.error_code = out.INVALID_JOINTS if "joint" in str(error) else out.INVALID_GOAL
            out.error_string = str(error)
            handle.abort()
            return out
        assert own is not None  # just told
        self.is_awake = True
        end = self.served.env.world.time + float(own.times[-1]) + SETTLING
        arm, feedback = self.served.robot.arm, FollowJointTrajectory.Feedback()
        feedback.joint_names = list(arm.names)
        while rclpy.ok() and self.served.trajectory is own and self.served.env.world.time < end:
            with self.lock:
                is_there, here = self.served.is_there, arm.positions()
                if handle.is_cancel_requested:
                    self.served.cancel()
            if handle.is_cancel_requested:
                handle.canceled()
                return out
            if is_there:
                out.error_code = out.SUCCESSFUL
                handle.succeed()
                return out
            feedback.desired.positions = own.at(self.served.progress).tolist()
            feedback.actual.positions = here.tolist()
            handle.publish_feedback(feedback)
            time.sleep(0.02)
        is_late = self.served.trajectory is own
        out.error_code = out.GOAL_TOLERANCE_VIOLATED if is_late else out.INVALID_GOAL
        out.error_string = "not there in time" if is_late else "something else moves the robot"
        handle.abort()
        return out

    def _may_grip(self, goal: Any) -> GoalResponse:
        gripper = self.served.robot.gripper
        if gripper is None or not gripper.is_movable or self.served.is_stopped:
            self.get_logger().error("the gripper holds fast in this task: give gripper=commanded")
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _grip(self, handle: Any) -> Any:
        gripper, out = self.served.robot.gripper, GripperCommand.Result()
        assert gripper is not None  # or the goal was refused
        wanted = float(handle.request.command.position)
        self.served.closing = float(np.clip(gripper.fraction(wanted), 0.0, 1.0))
        self.is_awake = True
        end, before = self.served.env.world.time + 3.0, -1.0
        while (
            rclpy.ok()
            and self.served.env.world.time < end
            and abs(gripper.closing() - before) > 1e-4
        ):
            before = gripper.closing()
            time.sleep(0.3)
        out.reached_goal = abs(gripper.closing() - self.served.closing) < 0.05
        out.stalled = not out.reached_goal
        told = gripper.config
        out.position = told.opened + gripper.closing() * (told.closed - told.opened)
        handle.succeed()
        return out


def _bones(person: Human) -> list[tuple[Sequence[float], Sequence[float]]]:
    places = {name: person.joint_pose(name).position for name in person.segments}
    carriers = {name: JOINTS[PARENTS[JOINTS.index(name)]] for name in places if name != JOINTS[0]}
    return [(places[a], places[b]) for b, a in carriers.items() if a in places]


def serve(
    served: ServedRobot,
    *,
    episodes: int = 0,
    speed: float = 1.0,
    namespace: str = "",
    prefix: str = "",
    on_end: Callable[[Pace], None] = lambda _: None,
) -> dict[int, bool]:
    """Serve a robot until Ctrl-C or the end of some episodes; return how they ended, by seed.

    Nothing moves until something is told. Each physics step begins when it is due, over `speed`.

    Args:
        served: The robot.
        episodes: How many, one seed after the other; 0 goes on.
        speed: Times real time.
        namespace: Of all but `/tf` and `/clock`.
        prefix: Of the names of frames.
        on_end: Told at the end how well time was kept.
    """
    make_ready()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = RobotNode(served, namespace, prefix=prefix)
    executor = MultiThreadedExecutor(4)
    executor.add_node(node)
    listening = threading.Thread(target=executor.spin, daemon=True)
    period = served.env.world.physics_dt / speed
    pace = Pace(period, node.lock, lambda k: None if k % TELLING else node.tell_joints())
    served.on_step = pace
    substeps = round(served.env.task.control_dt / served.env.world.physics_dt)
    try:
        listening.start()
        node.tell_episode("begin")
        pace.start()
        while not episodes or len(served.outcomes) < episodes:
            with node.lock:
                node.tell()
                is_over = node.is_awake and served.advance()
                for _ in range(0 if node.is_awake else substeps):
                    if not node.is_awake:
                        pace()
            if is_over or node.must_reset:
                _next(node, is_over=is_over, is_last=len(served.outcomes) == episodes)
                pace.start()
        time.sleep(0.5)  # so that the last messages go out
    finally:
        served.on_step = lambda: None
        on_end(pace)
        executor.shutdown(timeout_sec=1.0)
        rclpy.shutdown()
    return served.outcomes


def _next(node: RobotNode, *, is_over: bool, is_last: bool) -> None:
    """Say how an episode ended or that it pauses, and begin another one if it was not the last."""
    served, seed = node.served, node.served.env.seed
    node.tell_episode("end" if is_over else "pause")
    time.sleep(HEARD)  # or who plays may see the joints jump before
    if is_over:
        print_line(f"seed {seed}: {'success' if served.outcomes[seed] else 'no success'}")
    if not (is_over and is_last):
        with node.lock:
            served.reset(seed + is_over)
        node.must_reset = False
        node.tell_episode("begin")
