"""Developable ribbons in ruling-bending coordinates (Pan, Huang and Bao 2016).

The machine; what a ribbon is made of comes from ``formulations.ribbon_physics()``.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from casashell.ribbon.physics import RibbonPhysics
    from casashell.ribbon.ribbon import Ribbon, RibbonState

__all__ = ["Ribbon", "RibbonPhysics", "RibbonState"]

#: Where each name lives: loaded when asked for.
_PLACES = {
    "casashell.ribbon.physics": ("RibbonPhysics",),
    "casashell.ribbon.ribbon": ("Ribbon", "RibbonState"),
}


def __getattr__(name: str) -> Any:
    for module, names in _PLACES.items():
        if name in names:
            return getattr(import_module(module), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
