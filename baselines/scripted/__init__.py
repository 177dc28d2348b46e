"""Hand-written robot policies, one module a task, known to `make(..., policies=...)` as `scripted`."""

from . import ambulating as ambulating
from . import bathing as bathing  # registers its policy
from . import feeding as feeding
from . import limb_repositioning as limb_repositioning
from . import toileting as toileting
