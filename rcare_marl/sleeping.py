"""Bodies that sleep until something touches or moves them: furniture, while nobody uses it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rcare_marl.bullet import bullet

if TYPE_CHECKING:
    from .body import Body

# Bullet lets sleep what moves less than this for 2 s: its sum of squared speeds [m²/s² or rad²/s²].
STILLNESS = 1e-7


class SleepingBodies:
    """The bodies of one physics client that may sleep.

    Each joint of a body that is awake costs 2 microseconds a physics step, at rest or not; asleep it
    costs nothing. What is awake and touches a sleeping body wakes it in the same step. Whoever sets,
    drives or pushes it through `Body` wakes it for the step after: the first step of a push is lost.
    """

    def __init__(self, client: int) -> None:
        self._client = client
        self._bodies: list[Body] = []

    def __contains__(self, body: Body) -> bool:
        return body in self._bodies

    def add(self, body: Body) -> None:
        """Let a body sleep from now on whenever it is still."""
        bullet.changeDynamics(
            body.uid,
            -1,
            activationState=bullet.ACTIVATION_STATE_ENABLE_SLEEPING,
            sleepThreshold=STILLNESS,
            physicsClientId=self._client,
        )
        body.may_sleep = True
        self._bodies.append(body)

    def begin(self) -> None:
        """Put all to sleep, and let Bullet take note of it.

        Bullet notes in each physics step who is awake, and forgets to move the boxes of its broad phase
        along with who is not: somebody who slept before must wake for a step, or nothing could touch
        them where they are put next.
        """
        if not self._bodies:
            return
        self._set(bullet.ACTIVATION_STATE_WAKE_UP)
        # What has begun to fall or to settle in this step would wake itself: where joints are does not
        # matter yet, but that they rest.
        for body in self._bodies:
            for joint in body.joints.values():
                bullet.resetJointState(body.uid, joint.index, 0.0, 0.0, self._client)
        self._set(bullet.ACTIVATION_STATE_SLEEP)

    def _set(self, state: int) -> None:
        for body in self._bodies:
            bullet.changeDynamics(body.uid, -1, activationState=state, physicsClientId=self._client)
        bullet.stepSimulation(physicsClientId=self._client)
