"""Hand-written robot policies, one module a task, known to `make(..., policies=...)` as `scripted`."""

from . import feeding as feeding  # registers its policy
