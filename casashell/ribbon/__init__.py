"""Developable ribbons in ruling-bending coordinates (Pan, Huang and Bao 2016).

The machine; what a ribbon is made of comes from ``formulations.ribbon_physics()``.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from casashell.ribbon.bands import closed
    from casashell.ribbon.dynamics import simulate
    from casashell.ribbon.forces import PointLoad
    from casashell.ribbon.holds import Attachment, HeldEnd
    from casashell.ribbon.inverse import InverseRibbon, natural_ribbon
    from casashell.ribbon.physics import RibbonPhysics
    from casashell.ribbon.record import RibbonSimulation, RunStatus
    from casashell.ribbon.ribbon import Ribbon, RibbonState
    from casashell.ribbon.scene import Body, Guide, Scene
    from casashell.ribbon.statics import Equilibrium, Setting, equilibrium
    from casashell.ribbon.step import Rule

__all__ = [
    "Attachment",
    "Body",
    "Equilibrium",
    "Guide",
    "HeldEnd",
    "InverseRibbon",
    "PointLoad",
    "Ribbon",
    "RibbonPhysics",
    "RibbonSimulation",
    "RibbonState",
    "Rule",
    "RunStatus",
    "Scene",
    "Setting",
    "closed",
    "equilibrium",
    "natural_ribbon",
    "simulate",
]

#: Where each name lives: loaded when asked for.
_PLACES = {
    "casashell.ribbon.bands": ("closed",),
    "casashell.ribbon.dynamics": ("simulate",),
    "casashell.ribbon.forces": ("PointLoad",),
    "casashell.ribbon.holds": ("Attachment", "HeldEnd"),
    "casashell.ribbon.inverse": ("InverseRibbon", "natural_ribbon"),
    "casashell.ribbon.physics": ("RibbonPhysics",),
    "casashell.ribbon.record": ("RibbonSimulation", "RunStatus"),
    "casashell.ribbon.ribbon": ("Ribbon", "RibbonState"),
    "casashell.ribbon.scene": ("Body", "Guide", "Scene"),
    "casashell.ribbon.statics": ("Equilibrium", "Setting", "equilibrium"),
    "casashell.ribbon.step": ("Rule",),
}


def __getattr__(name: str) -> Any:
    for module, names in _PLACES.items():
        if name in names:
            return getattr(import_module(module), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
