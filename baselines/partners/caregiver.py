"""The caregiver's own doing as a script, for those who learn to correct it.

A caregiver who lifts a leg walks, kneels and grasps by deeds that are no actions (`agents.motion`), so that
she cannot be learned from nothing; a residual on this script can.
"""

from __future__ import annotations

from rcare_marl.envs.registry import register_policy
from rcare_marl.envs.tasks.dressing import lifts

register_policy("dressing", "caregiver", "scripted")(lifts)
