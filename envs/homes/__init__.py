"""CareHomes: houses made by rule from data, at three levels of accessibility.

All that others use of them is named here.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from .audit import audit as audit_home
from .care_home import CareHome, home_names
from .door import HINGE_DAMPING, Door
from .home_place import HomePlace, build_door, build_fixture, find_place
from .layout import load_house
from .occupancy import Obstacle, Occupancy
from .route import Route, Way
from .rule import LEVELS, Rules

if TYPE_CHECKING:
    from .drawing import floor_plan, home_picture

__all__ = [
    "HINGE_DAMPING",
    "LEVELS",
    "CareHome",
    "Door",
    "HomePlace",
    "Obstacle",
    "Occupancy",
    "Route",
    "Rules",
    "Way",
    "audit_home",
    "build_door",
    "build_fixture",
    "find_place",
    "floor_plan",
    "home_names",
    "home_picture",
    "load_house",
]


def __getattr__(name: str) -> object:
    if name in ("floor_plan", "home_picture"):  # they need what draws
        return import_module(f".drawing.{name}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
