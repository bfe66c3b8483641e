"""Built-in scenes of closed ribbons: a Moebius band, and chains of loops and of bands."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from casashell.app.ribbon_reader_tables import resting_band
from casashell.app.ribbon_setup import Actions, Course, Hold
from casashell.app.ribbon_shapes import frame_of, placed
from casashell.contact.obstacles import Plane
from casashell.ribbon.chain import reconstruct
from casashell.ribbon.loops import circle
from casashell.ribbon.physics import RibbonPhysics
from casashell.ribbon.ribbon import Ribbon, RibbonState
from casashell.ribbon.scene import Body, Scene
from casashell.typing import ArrayLike, FloatArray

#: Loops in a chain, and the distance of their centres over that of a loop's ends along the chain.
LINKS, PITCH = 9, 0.68
#: Plate stiffness [J] and density [kg/m2] of the bands of chains, of thin card.
_CARD: Final = (1e-3, 0.15)
_DOWN: Final = np.array([0.0, 0.0, -1.0])


def hanging_band(physics: RibbonPhysics) -> Scene:
    """A Moebius band of paper 30 x 3 cm, 5 cm above a table."""
    band = Ribbon(0.3, 0.03, 40, 2.7e-4, 0.08, ends="moebius")
    state = upright(band, resting_band(band, physics), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0))
    shape = reconstruct(band, state)
    low = min(shape.bottom[:, 2].min(), shape.top[:, 2].min())
    state = replace(state, origin=state.origin + (0.05 - low) * np.array([0.0, 0.0, 1.0]))
    table = Plane((0.0, 0.0, 1.0), 0.0, name="table")
    body = Body(band, state, name="band")
    return Scene((body,), physics, thickness=1e-3, obstacles=(table,))


def double_chain(physics: RibbonPhysics) -> Scene:
    """Two chains of 9 round loops with 20 segments each; held at their tops, apart, 20 degrees out."""
    loop = Ribbon(0.3, 0.012, 20, *_CARD, ends="loop")
    state = circle(loop)
    bodies: list[Body] = []
    for name, side in (("left", -1.0), ("right", 1.0)):
        top = np.array([0.06 * side, 0.0, 0.0])
        turn = Rotation.from_euler("y", -20.0 * side, degrees=True)
        bodies += chain(loop, state, name, top, np.asarray(turn.apply(_DOWN)))
    return Scene(tuple(bodies), physics, thickness=1e-3)


def moebius_chain(physics: RibbonPhysics) -> Scene:
    """A chain of 9 Moebius bands with 20 segments each, held at its top, led aside by 30 degrees."""
    band = Ribbon(0.3, 0.012, 20, *_CARD, ends="moebius")
    turn = Rotation.from_euler("y", 30.0, degrees=True)
    bodies = chain(band, resting_band(band, physics), "band", np.zeros(3), turn.apply(_DOWN))
    return Scene(tuple(bodies), physics, thickness=1e-3)


def chain(
    ribbon: Ribbon, state: RibbonState, name: str, top: ArrayLike, along: ArrayLike
) -> list[Body]:
    """`LINKS` ribbons of one shape, from ``top`` (3,) [m] on; each turned a quarter from the last.

    The first is held at its highest point.
    """
    down = np.asarray(along, dtype=np.float64)
    one = np.cross(down, [0.0, 1.0, 0.0])
    sides = (one, np.cross(down, one))
    bodies = []
    for k in range(LINKS):
        turned = upright(ribbon, state, -down, sides[k % 2])
        reach = reconstruct(ribbon, turned).middle @ down
        pitch = PITCH * (reach.max() - reach.min())
        place = np.asarray(top) + (k * pitch - reach.min()) * down
        link = replace(turned, origin=turned.origin + place)
        actions = Actions(holds=_held_top(ribbon, link, -down)) if k == 0 else Actions()
        bodies.append(Body(ribbon, link, actions, name=f"{name} {k}"))
    return bodies


def _held_top(ribbon: Ribbon, state: RibbonState, up: FloatArray) -> tuple[Hold, ...]:
    """The highest point of the centreline stays where it is."""
    middle = reconstruct(ribbon, state).middle[:-1]
    i = int(np.argmax(middle @ up))
    return (Hold(i * ribbon.segment, 0.0, Course.constant(middle[i])),)


def upright(ribbon: Ribbon, state: RibbonState, up: ArrayLike, axis: ArrayLike) -> RibbonState:
    """A closed ribbon around its centre: longest direction along ``up``, the flattest along ``axis``."""
    shape = reconstruct(ribbon, state)
    away = shape.middle[:-1] - shape.middle[:-1].mean(axis=0)
    long, _, flat = np.linalg.svd(away, full_matrices=False)[2]
    own = frame_of(long, flat)
    turn = frame_of(up, axis) @ own.T
    return placed(ribbon, state, turn @ state.frame, centre=(0.0, 0.0, 0.0))
