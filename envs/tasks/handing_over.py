"""Handing over: give a cup into the better hand of the person in the wheelchair, and let go of it."""

from dataclasses import dataclass

import numpy as np

from rcare_marl.agents.people.behaviour.behaviour_tree import Reach, StayStill
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.pose import Array, Pose
from rcare_marl.world import World

from ..care_env import CareEnv
from ..devices import Cup
from ..feasibility import Feasibility
from ..reach import Trial
from ..registry import register_policy, register_task
from ..scenes.meal import Meal, MealOptions
from ..state import Seen, State, Values, norm
from ..task import Role

# All our own choices. Of the cup from the hand: ahead, aside, up [m]; the spread is uniform, each way.
START, SPREAD, OFFER = np.array((0.16, 0.0, 0.14)), 0.03, np.array((0.04, 0.0, -0.03))
NEAR, HELD, TOUCH = 0.07, 0.5, 1.0  # where the hand closes [m]; [s]; where the robot stops [N]
GAIN, FAST, SEAT, GRASP = 2.0, 0.08, "wheelchair", ("grasp",)  # [1/s], [m/s]
TURNS = [Cup.facing((np.cos(a), np.sin(a))) for a in np.radians((180, 150, 210, 120, 240, 90, 270))]
ARMS = ("left_shoulder", "left_elbow_flexion", "right_shoulder", "right_elbow_flexion")


@dataclass(frozen=True)
class HandingOverOptions(MealOptions):
    """Settings of handing over; `shaped` weighs the terms of `paper`."""

    SHAPED_WEIGHTS = {"near": 1.0, "hurt": 1.0}  # our own choice


@dataclass(frozen=True, eq=False)
class CupState(State):
    """What handing over reads."""

    cup: Array  # its middle [m], shape [3]
    gap: Array  # from there to the hand [m], shape [3]
    taken: bool  # whether the hand holds it
    held: float  # how long it has, alone [s]


@register_task("handing_over")
class HandingOver(Meal):
    """A robot on the wheelchair hands a cup to the person who sits in it, at the hand that grips better.

    Randomised at reset: where it starts. Who can close neither hand cannot `grasp` it.
    Success and failure: the hand has had it alone for half a second, over the tolerance; too much force.
    """

    robot = Role(Robot, default="kinova_gen3", partner="scripted", gripper="commanded")
    recipient = Role(Human, default="kim", posture=SEAT, movable=ARMS, moves=GRASP, partner="takes")
    Options = HandingOverOptions

    def build(self, world: World) -> None:
        super().build(world)
        hands, self.cup = self.recipient.hands, Cup()
        self.side = max(hands, key=lambda side: hands[side].force, default="right")
        if self.side not in hands or hands[self.side].force <= 0.0:
            self.feasible = Feasibility(False, "neither hand of the recipient closes")
        body, self._joint = self.cup.spawn(world), f"{self.side}_middle1"
        self.recipient.may_take(body, hand=self.side)
        trials = [Trial([self._tool(at, q) for at in (START, OFFER)], hold=q) for q in TURNS]
        self._turn = self.search(world).find(trials, "the place before the hand").trial.hold
        self.reset(np.random.default_rng(0))
        self._bond = self.take_tool(self.robot, body, self.cup.in_tool)

    def _tool(self, at: Array, turn: Array) -> Pose:
        cup = self.recipient.joint_pose(self._joint).position + at
        return Pose(tuple(cup), tuple(turn)) @ self.cup.frame("middle").inverse()

    def reset(self, rng: np.random.Generator) -> None:
        tool = self._tool(START + rng.uniform(-SPREAD, SPREAD, 3), self._turn)
        self.robot.set_tool(tool)
        self.cup.body.set_base(self.robot.tool_pose() @ self.cup.in_tool)

    def read(self, now: State, before: CupState | None) -> CupState:
        cup, hands = np.array(self.cup.frame_in_world("middle").position), self.recipient.hands
        taken = self.side in hands and hands[self.side].holds(self.cup.body, -1)
        gap, alone = self.recipient.joint_pose(self._joint).position - cup, not self._bond.is_active
        held = before.held + self.control_dt if before and taken and alone else 0.0
        return CupState(**vars(now), cup=cup, gap=gap, taken=taken, held=held)

    def observables(self, role: str) -> list[Seen]:
        taken = Seen("is_taken", "1", 1, lambda s: s.taken)
        return [Seen("cup_to_hand", "m", 3, lambda s: s.gap), taken, self.contact_force()]

    def rewards(self, role: str, state: CupState) -> dict[str, Values]:
        hurt = self.for_the_rest(state, self.failed(state), -1.0)
        return self.options.weighted({"near": -norm(state.gap), "hurt": hurt})

    def is_success(self, state: CupState) -> Values:
        return state.held * self.options.tolerance >= HELD - 1e-9


@register_policy("handing_over", "recipient", "takes")
def takes(env: CareEnv, role: str) -> Reach:
    """Return a recipient who brings the better hand to the cup and closes it there."""
    assert isinstance(task := env.task, HandingOver)
    aim, dt = lambda: task.state.cup - OFFER, task.control_dt
    policy = Reach(task.recipient, task.side, aim, control_dt=dt)
    policy.grasps = lambda: bool(np.linalg.norm(task.state.gap) < NEAR)
    return policy


@register_policy("handing_over", "robot", "scripted")
class Giving(StayStill):
    """Brings the cup to the hand, stops at a touch, lets go once it is taken, and draws back."""

    def __init__(self, env: CareEnv, role: str) -> None:
        assert isinstance(robot := env.cast[role], Robot)
        super().__init__(robot.action_size)
        self._env, self._robot = env, robot

    def act(self) -> Array:
        state = self._env.task.state
        way = START if state.taken else GAIN * (state.gap + OFFER) * (state.force < TOUCH)
        arm = self._robot.tool_action(np.clip(way, -FAST, FAST), np.zeros(3))
        return np.append(arm, -float(state.taken))
