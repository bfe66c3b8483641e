"""Built-in scenes of ribbons (Pan 2016, Table I and Figs. 7-12).

The paper gives numbers of ribbons, the 150 segments of the falling one and the steps of the helix;
all other sizes are ours.  SI; up is +z.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from casashell.app.ribbon_chains import double_chain, hanging_band, moebius_chain
from casashell.app.ribbon_setup import Actions, Course, Hold, Load, RibbonSetup, Twist
from casashell.app.ribbon_shapes import frame_of, placed, waved, wound
from casashell.contact.obstacles import Plane
from casashell.io.toml_tables import did_you_mean
from casashell.ribbon.chain import reconstruct
from casashell.ribbon.physics import RibbonPhysics
from casashell.ribbon.ribbon import Ribbon
from casashell.ribbon.scene import Body, Guide, Scene

#: Copy paper: plate stiffness [J] and density [kg/m2].
PAPER: Final = (2.7e-4, 0.08)
#: Soft satin: the same of a ribbon that coils where it falls.
SATIN: Final = (1e-4, 0.1)

_NONE: Final = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Builtin:
    """A scene by name.

    about  one sentence;  size  ribbons and segments
    work   seconds of work that a second of motion takes on two cores, about
    """

    about: str
    size: str
    seconds: float
    step: float
    work: float
    build: Callable[[RibbonPhysics], Scene]


def cantilever(physics: RibbonPhysics) -> Scene:
    """A paper strip, clamped level and let go; it comes to rest as the heavy elastica.

    rho g L^3 / D = 23.25: its tip ends at (0.4046, -0.8481) L.
    """
    strip = Ribbon(0.2, 0.03, 40, *PAPER, clamp_crease=True)
    return Scene((Body(strip, name="strip"),), physics)


def helix(physics: RibbonPhysics) -> Scene:
    """A strip wound on a rod of 2 cm, its rulings at cotangent 0.5, hangs from its clamp and unrolls."""
    strip = Ribbon(0.5, 0.03, 40, *PAPER)
    # The rod is along (slope, 1, 0) in the axes of the strip: let that point down.
    slope = 0.5
    down, side = np.array([0.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0])
    frame = frame_of(slope * down + side, down - slope * side)
    state = placed(strip, wound(strip, 0.02, slope), frame)
    return Scene((Body(strip, state, name="strip"),), physics, thickness=5e-4)


def torsion(physics: RibbonPhysics) -> Scene:
    """A strip 10 x 1, clamped, pulled at its end and twisted there by a turn, then held.

    From 1.2 turns on it would writhe and be pressed against itself (docs/ribbons.md).
    """
    strip = Ribbon(10.0, 1.0, 20, 1.0, 1.0)
    pull = Load(strip.length, 0.0, Course.constant((20.0, 0.0, 0.0)))
    turns = Course([0.0, 4.0], [0.0, 1.0])
    twist = Twist(np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]), turns)
    body = Body(
        strip,
        # Not quite flat: a flat strip has no rulings, and would not know which way to give.
        waved(strip, 0.01, 2.5, 0.1),
        Actions(loads=(pull,)),
        guides=(Guide((18, 19), twist, 100.0),),
        name="strip",
    )
    return Scene((body,), physics, gravity=_NONE, thickness=0.02)


def dragging(physics: RibbonPhysics) -> Scene:
    """A strip 10 x 1, clamped; a corner of its free end is dragged up, back over the clamp and aside."""
    strip = Ribbon(10.0, 1.0, 20, 1.0, 0.01)
    # Bent a little: the end of a flat, taut strip can follow no hand at first.
    state = wound(strip, -12.0)
    shape = reconstruct(strip, state)
    places = [shape.top[-1], [5.0, 2.0, 5.0], [-1.0, 4.0, 5.0], [-3.0, -4.0, 3.0], [4.0, -5.0, 1.0]]
    hand = Hold(strip.length, 0.5, Course([0.0, 1.0, 2.0, 3.0, 4.0], places))
    body = Body(strip, state, Actions(holds=(hand,)), name="strip")
    return Scene((body,), physics)


def falling(physics: RibbonPhysics) -> Scene:
    """A curl of satin, 1.2 m of ribbon wound to six turns, falls on the ground and heaps up."""
    radius, slope = 0.03, 0.35
    strip = Ribbon(1.2, 0.02, 150, *SATIN, ends="free")
    start = wound(strip, radius, slope)
    # A curl by nature, of the same radius: the ribbon is at rest in the air.  Angles at rest leave
    # the rulings free to turn, which in a curved sheet costs about as much as to flatten it.
    strip = replace(
        strip,
        rest_angles=start.angles,
        target_rulings=start.slopes,
        regulariser=(strip.length / radius) ** 2,
    )
    up, side = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
    frame = frame_of(slope * up + side, up - slope * side)
    state = placed(strip, start, frame, origin=(0.0, 0.0, 0.04))
    ground = Plane((0.0, 0.0, 1.0), 0.0, name="ground")
    body = Body(strip, state, name="ribbon")
    return Scene((body,), physics, thickness=1e-3, obstacles=(ground,))


SCENES: Final[Mapping[str, Builtin]] = {
    "moebius": Builtin(
        "a Moebius band of paper falls on a table",
        *("1 ribbon, 40 segments", 0.6, 0.01, 25.0, hanging_band),
    ),
    "cantilever": Builtin(
        "a strip of paper, clamped level and let go, until it hangs as the heavy elastica",
        *("1 ribbon, 40 segments", 1.0, 0.01, 8.0, cantilever),
    ),
    "helix": Builtin(
        "a wound strip of paper hangs from its clamp and unrolls (Fig. 8)",
        *("1 ribbon, 40 segments", 0.5, 0.01, 23.0, helix),
    ),
    "torsion": Builtin(
        "extreme torsion: a pulled strip is twisted by a turn, short of touching itself (Fig. 9)",
        *("1 ribbon, 20 segments", 6.0, 0.05, 2.0, torsion),
    ),
    "dragging": Builtin(
        "extreme dragging: a hand leads a corner of a clamped strip around (Fig. 7)",
        *("1 ribbon, 20 segments", 4.0, 0.02, 12.0, dragging),
    ),
    "falling": Builtin(
        "a curl of satin falls on the ground and heaps up, with self-collision (Fig. 12)",
        *("1 ribbon, 150 segments", 0.5, 0.005, 90.0, falling),
    ),
    "double-chain": Builtin(
        "two chains of 9 loops swing into each other (Table I)",
        *("18 ribbons, 360 segments", 0.5, 0.01, 180.0, double_chain),
    ),
    "moebius-chain": Builtin(
        "a chain of 9 Moebius bands is let go (Table I)",
        *("9 ribbons, 180 segments", 0.5, 0.01, 110.0, moebius_chain),
    ),
}


def builtin_setup(name: str) -> RibbonSetup:
    """The scene of a name; ValueError that names the nearest one."""
    if name not in SCENES:
        raise ValueError(
            f"no scene '{name}', and no file of that name; {did_you_mean(name, tuple(SCENES))} "
            "(--list shows all)"
        )
    from formulations import ribbon_physics

    kept = SCENES[name]
    return RibbonSetup(
        name, kept.build(ribbon_physics()), kept.seconds, kept.step, about=kept.about, source=name
    )
