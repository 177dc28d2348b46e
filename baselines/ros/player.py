"""Plays a policy on the topics of a robot, behind a safety layer. Imports ROS: see docs/ros.md."""

from __future__ import annotations

import contextlib
import json
import queue
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import TwistStamped, WrenchStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool

from rcare_marl.agents.policy import Policy
from rcare_marl.console import print_line
from rcare_marl.errors import RcareError

from . import messages
from .pace import make_ready
from .safety import Guard, SafetyLimits
from .twin import Twin

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
CHECKS = 0.01  # [s] between looks at the clock; our own choice
KEPT = 50  # postures, of which that of the time of the scene is taken


@dataclass
class Played:
    """What came of playing.

    Attributes:
        outcomes: Whether each episode ended well, by its seed.
        stops: Why the robot was stopped.
        ages: How old the scene was when its answer went out [s], one a message.
    """

    outcomes: dict[int, bool] = field(default_factory=dict)
    stops: list[str] = field(default_factory=list)
    ages: list[float] = field(default_factory=list)


class PlayerNode(Node):
    """Plays a policy: one answer to each scene that is told, while the guard permits.

    Messages and the guard have a thread of their own, so it watches while the policy thinks.
    """

    def __init__(
        self,
        twin: Twin,
        policy: Policy,
        limits: SafetyLimits,
        namespace: str = "",
        *,
        dry_run: bool = False,
    ) -> None:
        """Listen to a robot; with `dry_run` say what it would be told, and tell it nothing."""
        super().__init__("rcare_marl_player", namespace=namespace)
        self._twin, self._policy, self._dry = twin, policy, dry_run
        self.played = Played()
        self.guard = Guard(limits, twin.joints, twin.robot.arm.velocity, self._on_stop)
        self._out = self.create_publisher(TwistStamped, "servo/twist", 10)
        self._said = self.create_publisher(String, "safety", LATCHED)
        self._stop = self.create_client(SetBool, "emergency_stop")
        self._seen: deque[tuple[float, Any, Any]] = deque(maxlen=KEPT)
        self._lock = threading.Lock()  # of the guard
        self.guard.pause(np.inf)  # until an episode begins
        self._scenes: queue.SimpleQueue[str] = queue.SimpleQueue()
        listen = self.create_subscription
        listen(JointState, "joint_states", self._on_joints, 50)
        listen(WrenchStamped, "wrench", self._on_wrench, 10)
        listen(String, "scene", lambda message: self._scenes.put(message.data), 10)
        listen(String, "episode", self._on_episode, LATCHED)
        self.create_timer(CHECKS, self._check)

    def now(self) -> float:
        """Return the time of stamps [s]."""
        return float(self.get_clock().now().nanoseconds * 1e-9)

    def _on_stop(self, reason: str) -> None:
        self.played.stops.append(reason)
        self.get_logger().error(f"stopped: {reason}")
        self._said.publish(String(data=reason))
        self._tell(np.zeros(6))
        if not self._dry:
            self._stop.call_async(SetBool.Request(data=True))

    def _check(self) -> None:
        with self._lock:
            self.guard.check(self.now())

    def _on_joints(self, message: JointState) -> None:
        names = list(message.name)
        positions, rates = np.array(message.position), np.array(message.velocity)
        stamp = messages.seconds(message.header.stamp)
        with self._lock:
            if self.guard.is_paused:
                return
            self.guard.joints(stamp, self.now(), names, positions, rates)
            if not self.guard.fault:
                order = [names.index(name) for name in self._twin.joints]
                self._seen.append((stamp, positions[order], rates[order]))

    def _on_wrench(self, message: WrenchStamped) -> None:
        told = message.wrench
        values = np.array(messages.vector(told.force) + messages.vector(told.torque))
        with self._lock:
            self.guard.wrench(messages.seconds(message.header.stamp), self.now(), values)

    def think(self, timeout: float) -> None:
        """Answer the scene that was told last, or the next one in some time [s]."""
        with contextlib.suppress(queue.Empty):
            text = self._scenes.get(timeout=timeout)
            while not self._scenes.empty():
                text = self._scenes.get()
            self._answer(text)

    def _answer(self, text: str) -> None:
        with self._lock:
            if not self._seen or self.guard.is_paused or self.guard.fault:
                return
            seen = list(self._seen)
        began = time.perf_counter()
        try:
            told = json.loads(text)
            stamp, gap = float(told["stamp"]), float(told["separation"])
            _, positions, rates = min(seen, key=lambda each: abs(each[0] - stamp))
            numbers = self._twin.see(positions, rates, told["state"])
            tool = np.array(self._twin.robot.tool_pose().position)
            with self._lock:
                self.guard.scene(stamp, self.now(), np.append(numbers, gap), tool)
            twist = self._twin.twist(self._policy)
        except (RcareError, ValueError, KeyError, TypeError) as error:
            with self._lock:
                self.guard.stop(f"scene or policy: {error}")
            return
        took = time.perf_counter() - began
        with self._lock:
            allowed = self.guard.permit(twist, self.now(), gap=gap, took=took)
            if not self.guard.is_paused:
                self._tell(allowed)
        self.played.ages.append(self.now() - stamp)

    def _tell(self, twist: np.ndarray[Any, Any]) -> None:
        if self._dry:
            self.get_logger().info(f"would tell {np.round(twist, 3).tolist()}")
            return
        out = TwistStamped()
        out.header.stamp, out.header.frame_id = self.get_clock().now().to_msg(), messages.WORLD
        linear, angular = out.twist.linear, out.twist.angular
        linear.x, linear.y, linear.z = (float(value) for value in twist[:3])
        angular.x, angular.y, angular.z = (float(value) for value in twist[3:])
        self._out.publish(out)

    def _on_episode(self, message: String) -> None:
        told = json.loads(message.data)
        with self._lock:
            was_paused = self.guard.is_paused
            if told["event"] == "begin":
                self._seen.clear()
                self._policy.reset(np.random.default_rng([told["seed"], 0]))
                self.guard.release(told["stamp"])
                print_line(f"seed {told['seed']}: plays")
                return
            self.guard.pause(self.now())
        if told["event"] == "end" and not was_paused:
            self.played.outcomes[told["seed"]] = bool(told["success"])


def play(
    twin: Twin,
    policy: Policy,
    limits: SafetyLimits,
    *,
    episodes: int = 0,
    namespace: str = "",
    dry_run: bool = False,
    is_over: Callable[[Played], bool] = lambda _: False,
) -> Played:
    """Play a policy until Ctrl-C, a stop, or the end of some episodes.

    Args:
        twin: The policy's copy of the scene.
        policy: What plays, made for the twin.
        limits: When to stop.
        episodes: How many; 0 goes on.
        namespace: Of the robot.
        dry_run: Whether to say what the robot would be told, and tell it nothing.
        is_over: Asked all the time whether to end.
    """
    twin.rehearse(policy)
    make_ready()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = PlayerNode(twin, policy, limits, namespace, dry_run=dry_run)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    listening = threading.Thread(target=executor.spin, daemon=True)
    listening.start()
    try:
        while not node.played.stops and not is_over(node.played):
            if episodes and len(node.played.outcomes) >= episodes:
                break
            node.think(0.1)
        time.sleep(0.5)  # so that the last messages go out
    finally:
        executor.shutdown(timeout_sec=1.0)
        rclpy.shutdown()
    for reason in node.played.stops:
        print_line(f"stopped: {reason}")
    return node.played
