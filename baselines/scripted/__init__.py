"""Hand-written robot policies, one module a task, known to `make(..., policies=...)` as `scripted`."""

from functools import partial

from rcare_marl.envs.registry import guard_policy

from .. import partners as partners  # so that one entry point loads all policies of the package
from .. import trained as trained
from ..trained.elsewhere import SCRIPTS, check_robot, figures
from . import ambulating as ambulating
from . import bathing as bathing  # registers its policy
from . import dressing as dressing
from . import drinking as drinking
from . import feeding as feeding
from . import limb_repositioning as limb_repositioning
from . import phyrc_bathing as phyrc_bathing
from . import phyrc_dressing as phyrc_dressing
from . import scratching as scratching
from . import social_coaching as social_coaching
from . import toileting as toileting
from . import tooth_brushing as tooth_brushing

for _task in figures(SCRIPTS):
    guard_policy(_task, "robot", "scripted", partial(check_robot, task=_task))
