"""The physics of casashell: one symbolic energy a file."""

from formulations.area_gravity import area_gravity
from formulations.discrete_shell import discrete_shell
from formulations.edge_stretch import edge_stretch
from formulations.hinge_bending import hinge_bending
from formulations.proximity import proximity
from formulations.ribbon import ribbon_physics
from formulations.ruling_bending import ruling_bending

__all__ = [
    "area_gravity",
    "discrete_shell",
    "edge_stretch",
    "hinge_bending",
    "proximity",
    "ribbon_physics",
    "ruling_bending",
]
