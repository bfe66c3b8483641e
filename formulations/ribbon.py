"""All that makes a developable ribbon, for `casashell.ribbon`."""

from __future__ import annotations

from casashell.ribbon.physics import RibbonPhysics
from formulations import ribbon_closing, ribbon_energy, ribbon_inertia, ruling_bending


def ribbon_physics() -> RibbonPhysics:
    """Bending, gravity, loads and inertia of Pan 2016; `dataclasses.replace` changes one of them."""
    return RibbonPhysics(
        sadowsky=ribbon_energy.sadowsky(),
        wunderlich=ribbon_energy.wunderlich(),
        rulings=ribbon_energy.rulings(),
        gravity=ribbon_energy.gravity(),
        guiding=ribbon_energy.guiding(),
        load=ribbon_energy.load(),
        attachment=ribbon_energy.attachment(),
        consistent=ribbon_inertia.consistent(),
        lumped=ribbon_inertia.lumped(),
        smooth=ribbon_closing.smooth(),
        crease=ribbon_closing.crease(),
        held=ribbon_closing.held(),
        junction=ribbon_closing.junction(),
        ruling=ribbon_closing.ruling(),
        link=ruling_bending.link(),
        rigid_begin=ruling_bending.rigid_begin(),
        linear_piece=ribbon_inertia.linear_piece(),
        hermite_piece=ribbon_inertia.hermite_piece(),
    )
