"""What stands in the rooms; each module registers its makers."""

from . import appliance as appliance
from . import assistive as assistive
from . import bathroom as bathroom
from . import bathroom_basin as bathroom_basin
from . import bathroom_bath as bathroom_bath
from . import bathroom_storage as bathroom_storage
from . import bedroom as bedroom
from . import dining as dining
from . import drapery as drapery
from . import gym as gym
from . import hall as hall
from . import kitchen as kitchen
from . import kitchen_ornament as kitchen_ornament
from . import laundry as laundry
from . import living as living
from . import storage as storage
from . import study as study
