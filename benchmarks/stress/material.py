"""Families about stiffness, size and mass."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.stress.case import Case, Twin, only, predicted, soft, stiff_side
from benchmarks.stress.shapes import (
    Setup,
    flag,
    hat_on_head,
    page_on_table,
    sheet_on_floor,
    skirt_on_waist,
)
from casashell.contact.obstacles import Capsule, Cone, Plane
from casashell.status import Status

#: Scenes in the linear regime: strains of the sag below 1e-3 and forces well inside the cones.
BASES: dict[str, Callable[[], Setup]] = {
    "hat": hat_on_head,
    "skirt": skirt_on_waist,
    "page": page_on_table,
    "flag": flag,
}


def _stiffened(base: Callable[[], Setup], stretch: float, bend: float) -> Callable[[], Setup]:
    def make() -> Setup:
        setup = base()
        return replace(setup, stretch=setup.stretch * stretch, bend=setup.bend * bend)

    return make


def stiffness(kind: str) -> list[Case]:
    """Stretch, bend or both over twelve decades about scenes of the linear regime.

    Upwards the same stresses need smaller strains and the elastic Hessian grows, so that what was
    stable stays stable.  Downwards there is no theorem.
    """
    cases = []
    for name, base in BASES.items():
        for decade in range(-6, 7):
            factor = 10.0**decade
            along, across = (factor if kind in (k, "both") else 1.0 for k in ("stretch", "bend"))
            made = _stiffened(base, along, across)
            cases.append(
                Case(f"{name} x 1e{decade}", factor, made, stiff_side if decade >= 0 else soft())
            )
    return cases


def _scaled(base: Callable[[], Setup], s: float, physics: bool) -> Callable[[], Setup]:
    """Lengths times s; with ``physics`` k_L times s^2 and k_theta times s^3 as well."""

    def make() -> Setup:
        setup = base()
        obstacles = tuple(_scaled_obstacle(o, s) for o in setup.obstacles)
        tolerance = None if setup.tolerance is None else setup.tolerance * s
        grown = replace(
            setup.moved(s * setup.target.vertices), obstacles=obstacles, tolerance=tolerance
        )
        if not physics:
            return grown
        return replace(grown, stretch=setup.stretch * s**2, bend=setup.bend * s**3)

    return make


def _scaled_obstacle(obstacle: object, s: float) -> Plane | Cone | Capsule:
    def times(point: tuple[float, float, float]) -> tuple[float, float, float]:
        return (s * point[0], s * point[1], s * point[2])

    match obstacle:
        case Plane():
            return replace(obstacle, offset=s * obstacle.offset)
        case Cone():
            length = None if obstacle.length is None else s * obstacle.length
            return replace(obstacle, apex=times(obstacle.apex), length=length)
        case Capsule():
            return Capsule(
                times(obstacle.a), times(obstacle.b), s * obstacle.radius, obstacle.friction
            )
    raise ValueError(f"no rule to scale a {type(obstacle).__name__}")


def scales() -> list[Case]:
    """Mesh scale 1e-3 .. 1e3: with the material every energy times s^3, the shape times s."""
    cases = []
    for name, base in BASES.items():
        for decade in (-3, -2, -1, 1, 2, 3):
            s = 10.0**decade
            twin = Twin(base, lambda rest, s=s: rest / s, 1e-9)  # type: ignore[misc]
            cases.append(
                Case(f"{name} similar 1e{decade}", s, _scaled(base, s, True), stiff_side, twin)
            )
            # Weight over bending stiffness goes with s^3: smaller is stiffer.
            told = stiff_side if s < 1.0 else soft()
            cases.append(Case(f"{name} same material 1e{decade}", s, _scaled(base, s, False), told))
    return cases


def masses() -> list[Case]:
    """Parts without mass, no gravity, faint, strong and upward gravity."""
    cases = []
    for exponent in (-300, -150, -12, -6, -3, 1, 2, 3, 6):
        g = 10.0**exponent
        for name, base in BASES.items():
            told = stiff_side if g < 9.81 else soft()
            cases.append(Case(f"{name} g 1e{exponent}", g, _gravity(base, g), told))
    for name, base in BASES.items():
        held = only(
            Status.SOLVED, because="no weight: the target is its natural shape, pins hold it"
        )
        loose = only(Status.UNSTABLE, because="no weight: nothing presses the shell on, neutral")
        told = held if name == "flag" else loose
        cases.append(Case(f"{name} g 0", 0.0, _gravity(base, 0.0), told))
        lifted = only(
            Status.INFEASIBLE, because="weight pulls every vertex off: lifting the shell is a proof"
        )
        told_up = stiff_side if name == "flag" else lifted
        if name != "skirt":  # the waist may hold a skirt that falls upwards by friction
            cases.append(Case(f"{name} upwards", -9.81, _gravity(base, -9.81), told_up))
        for share in (0.1, 0.5, 0.9):
            cases.append(Case(f"{name} massless {share}", share, _massless(base, share), predicted))
    for share in (0.1, 0.5, 0.9, 1.0):
        told = only(Status.SOLVED, because="flat on the floor: the target is its natural shape")
        none = only(Status.UNSTABLE, because="no mass at all: nothing presses the sheet down")
        base = _massless(sheet_on_floor, share)
        cases.append(Case(f"floor massless {share}", share, base, told if share < 1.0 else none))
    return cases


def _gravity(base: Callable[[], Setup], g: float) -> Callable[[], Setup]:
    return lambda: replace(base(), gravity=(0.0, -g, 0.0))


def _massless(base: Callable[[], Setup], share: float) -> Callable[[], Setup]:
    """The first faces of the mesh get density 0."""

    def make() -> Setup:
        setup = base()
        count = len(setup.target.faces)
        density = np.full(count, float(np.mean(setup.density)))
        density[: round(share * count)] = 0.0
        return replace(setup, density=density)

    return make
