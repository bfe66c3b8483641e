"""Families about what holds the shell: friction, contacts, pins, several pieces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.stress.case import Case, Twin, only, predicted, soft, stiff_side
from benchmarks.stress.material import BASES
from benchmarks.stress.oracle import CERTIFIED, SOFT, UNHELD, Expected
from benchmarks.stress.shapes import (
    Setup,
    flag,
    hat_on_head,
    page_on_table,
    sheet,
    sheet_on_floor,
    skirt_on_waist,
    together,
)
from casashell.contact.obstacles import Plane, Sphere
from casashell.status import Status

S = Status
SLIDES = Expected(UNHELD, "steeper than the friction angle, whatever the stresses")


def cone_boundary() -> list[Case]:
    """A sheet on a plane whose tilt differs from the friction angle by a relative amount."""
    cases = []
    for exponent in (-1, -2, -3, -4, -6, -8, -10):
        for sign in (1.0, -1.0):
            gap = sign * 10.0**exponent
            tilt = float(np.arctan(0.5 * (1.0 + gap)))
            if gap > 0.0:
                told = SLIDES
            elif gap <= -0.01:
                told = only(S.SOLVED, because="each vertex holds its own weight inside the cone")
            else:
                told = Expected(
                    CERTIFIED | {S.CONE_VIOLATED},
                    "feasible; a program that stays 0.5 % inside the cones may not see it",
                )
            cases.append(Case(f"tilt {gap:+g}", gap, _tilted(0.5, tilt), told))
    exact = Expected(CERTIFIED | UNHELD, "on the boundary: rounding decides")
    cases.append(Case("tilt 0", 0.0, _tilted(0.5, float(np.arctan(0.5))), exact))
    return cases


def _tilted(friction: float, tilt: float) -> Callable[[], Setup]:
    return lambda: sheet_on_floor(friction, tilt)


def friction() -> list[Case]:
    """Friction from none to 100 on every contact scene."""
    cases = []
    for name, base in (("hat", hat_on_head), ("skirt", skirt_on_waist), ("page", page_on_table)):
        for mu in (0.0, 1e-6, 1e-3, 0.01, 0.1, 0.3, 1.0, 10.0, 100.0, 1e6):
            told = predicted if mu > 0.0 else soft("normal forces alone balance by symmetry")
            cases.append(Case(f"{name} mu {mu:g}", mu, _rough(base, mu), told))
    for mu in (0.0, 0.1, 10.0, 100.0, 1e6):
        flat = only(S.SOLVED, because="flat on the floor: the target is its natural shape")
        steep = SLIDES if mu < 1.0 else flat
        cases.append(Case(f"floor mu {mu:g}", mu, _tilted(mu, 0.0), flat))
        cases.append(Case(f"45 degrees mu {mu:g}", mu, _tilted(mu, float(np.pi / 4)), steep))
    return cases


def _rough(base: Callable[[], Setup], mu: float) -> Callable[[], Setup]:
    return lambda: replace(base(), friction=mu)


def contact_counts() -> list[Case]:
    """From no contact over one, two and three to every vertex."""
    nothing = only(S.INFEASIBLE, because="nothing holds it: falling straight down is a proof")
    neutral = Expected(
        frozenset({S.UNSTABLE, S.CONE_VIOLATED, S.ITERATION_LIMIT}),
        "one point: it turns about the normal at least; masses might balance it",
    )
    cases = [
        Case("none", 0.0, lambda: replace(hat_on_head(), obstacles=()), nothing),
        Case("one, under the centre", 1.0, _propped([(0.5, 0.5)]), neutral),
        Case(
            "one, in a corner", 1.0, _propped([(0.0, 0.0)]), Expected(UNHELD, "weight to one side")
        ),
        Case("one, at a side", 1.0, _propped([(0.0, 0.5)]), Expected(UNHELD, "weight to one side")),
    ]
    two = Expected(UNHELD, "two balls under the middle line: it tips without resistance")
    cases += [
        Case("two, under the middle", 2.0, _propped([(0.5, 0.0), (0.5, 1.0)]), two),
        Case("two, on one side", 2.0, _propped([(0.0, 0.0), (0.0, 1.0)]), Expected(UNHELD, "tips")),
    ]
    held = only(S.SOLVED, because="the centre of mass is above the triangle of three stiff props")
    outside = Expected(UNHELD, "the centre of mass is outside the triangle of the props")
    cases += [
        Case("three", 3.0, _propped([(0.0, 0.0), (0.0, 1.0), (1.0, 0.5)]), held),
        Case("four corners", 4.0, _propped([(0, 0), (0, 1), (1, 0), (1, 1)]), held),
        Case("three on one side", 3.0, _propped([(0, 0), (0, 1), (0.25, 0.5)]), outside),
    ]
    flat = only(S.SOLVED, because="flat on the floor: the target is its natural shape")
    cases.append(Case("all", 42.0, sheet_on_floor, flat))
    ball = replace(page_on_table(), obstacles=(), pinned=())
    cases.append(Case("none, page", 0.0, lambda: ball, nothing))
    return cases


def _propped(places: list[tuple[float, float]]) -> Callable[[], Setup]:
    """A stiff flat sheet on small balls under the vertices at these shares of its sides."""

    def make() -> Setup:
        mesh = sheet(5, 5, 0.2, 0.2)
        balls = tuple(Sphere((0.2 * u, -0.01, 0.2 * v), 0.01, friction=0.5) for u, v in places)
        return Setup(mesh, balls, stretch=2e3, bend=1.0)

    return make


def pins() -> list[Case]:
    """One pin, lines of pins, all pinned, pins with contacts, nothing."""
    to_one_side = only(
        S.INFEASIBLE, because="every loose vertex is on one side of the line: turning is a proof"
    )
    both_sides = Expected(
        frozenset({S.UNSTABLE, S.ITERATION_LIMIT, S.CONE_VIOLATED, S.TOO_SOFT}),
        "weight on both sides of the line: masses could balance it, no proof",
    )
    hangs = only(S.SOLVED, because="hangs from a line in its own plane: a stable pendulum, stiff")
    stands = only(S.UNSTABLE, because="stands on a line of pins: an inverted pendulum")
    line = tuple(range(7))
    cases = [
        Case("line, weight to one side", 7, lambda: _flat_sheet(line), to_one_side),
        Case("two pins, weight to one side", 2, lambda: _flat_sheet((0, 6)), to_one_side),
        Case("one corner pin", 1, lambda: _flat_sheet((0,)), to_one_side),
        Case("middle line", 7, lambda: _flat_sheet(tuple(range(14, 21))), both_sides),
        Case("hangs from its top line", 7, lambda: _upright(line, hanging=True), hangs),
        Case("hangs from two pins", 2, lambda: _upright((0, 6), hanging=True), hangs),
        Case("stands on its bottom line", 7, lambda: _upright(line, hanging=False), stands),
        Case("clamped on two lines", 14, lambda: _flat_sheet(tuple(range(14))), predicted),
        Case("three corners", 3, lambda: _flat_sheet((0, 6, 35)), predicted),
        Case("all pinned", 42, lambda: _flat_sheet(tuple(range(42))), predicted),
        Case("all but one", 41, lambda: _flat_sheet(tuple(range(1, 42))), predicted),
        Case("line, 1e-9 off", 7, lambda: _nearly_line(1e-9), soft("a line but for 1e-9 m")),
        Case("line, 1e-6 off", 7, lambda: _nearly_line(1e-6), soft("a line but for 1e-6 m")),
        Case("line, 1e-3 off", 7, lambda: _nearly_line(1e-3), soft("a line but for 1e-3 m")),
    ]
    one_hangs = Expected(
        frozenset({S.UNSTABLE, S.ITERATION_LIMIT}), "hangs from one point: free about the vertical"
    )
    cases.append(Case("hangs from one pin", 1, lambda: _upright((3,), hanging=True), one_hangs))
    for name, base in BASES.items():
        if name != "flag":
            cases.append(Case(f"{name} and one pin", 1, _pinned(base, 1), stiff_side))
            cases.append(Case(f"{name} and six pins", 6, _pinned(base, 6), stiff_side))
    return cases


def _flat_sheet(pinned: tuple[int, ...]) -> Setup:
    return Setup(sheet(6, 7, 0.25, 0.3), (), pinned, stretch=2e3, bend=1.0)


def _upright(pinned: tuple[int, ...], *, hanging: bool) -> Setup:
    flat = _flat_sheet(pinned)
    x, _, z = flat.target.vertices.T
    return flat.moved(np.stack([0.0 * x, -x if hanging else x, z], axis=1))


def _nearly_line(off: float) -> Setup:
    flat = _flat_sheet(tuple(range(7)))
    points = flat.target.vertices.copy()
    points[3, 0] -= off
    return flat.moved(points)


def _pinned(base: Callable[[], Setup], count: int) -> Callable[[], Setup]:
    """The last vertices of the mesh, far from the contacts, are pinned as well."""

    def make() -> Setup:
        setup = base()
        last = len(setup.target.vertices)
        if base is page_on_table:  # its last row stands on the table; its middle does not
            last = last // 2
        return replace(setup, pinned=tuple(range(last - count, last)))

    return make


def pieces() -> list[Case]:
    """Disconnected pieces: each by itself; one unheld piece spoils the whole."""
    both = only(S.SOLVED, because="each piece is a scene of the linear regime")
    falls = only(S.INFEASIBLE, because="one piece is held by nothing: its fall is a proof")
    slides = Expected(UNHELD, "one piece hangs from one pin only")
    count = 135

    def two_flags() -> Setup:
        return together(flag(), flag(), (1.0, 0.0, 0.0))

    def first(rest: np.ndarray) -> np.ndarray:
        return np.asarray(rest[:count])

    cases = [
        Case("two flags", 2, two_flags, both, Twin(flag, first, 1e-9)),
        Case(
            "page and flag",
            2,
            lambda: together(page_on_table(), flag(), (0.0, 0.5, 0.0)),
            both,
            Twin(page_on_table, first, 1e-9),
        ),
        Case(
            "flag, and one in the air",
            2,
            lambda: together(flag(), replace(flag(), pinned=()), (1.0, 0.0, 0.0)),
            falls,
        ),
        Case(
            "flag, and one on a pin",
            2,
            lambda: together(flag(), replace(flag(), pinned=(0,)), (1.0, 0.0, 0.0)),
            slides,
        ),
    ]
    for distance in (1e3, 1e6):
        far = Case(
            f"two flags {distance:g} m apart",
            distance,
            lambda d=distance: together(flag(), flag(), (d, 0.0, 0.0)),  # type: ignore[misc]
            soft("coordinates of the second round"),
        )
        cases.append(far)
    return cases


def duplicates() -> list[Case]:
    """Vertices that touch two obstacles: the same floor twice, corners, a slit."""
    table = Plane((0.0, 1.0, 0.0), 0.0, friction=0.4)
    same = only(S.SOLVED, because="two equal tables: the forces share, the sum is as before")
    smooth = replace(table, friction=0.0)
    slit = Plane((0.0, -1.0, 0.0), 0.0, friction=0.5)
    floor = Plane((0.0, 1.0, 0.0), 0.0, friction=0.5)
    flat = only(S.SOLVED, because="flat on the floor: the target is its natural shape")
    squeezed = Expected(
        CERTIFIED | {S.CONE_VIOLATED},
        "floor carries all; contacts of the ceiling have to push a little too, which is possible",
    )

    def with_obstacles(base: Callable[[], Setup], *more: Plane) -> Callable[[], Setup]:
        return lambda: replace(base(), obstacles=more)

    wall = Plane((1.0, 0.0, 0.0), 0.0, friction=0.5)
    page_wall = Plane((1.0, 0.0, 0.0), -0.15 / np.pi, friction=0.5)
    return [
        Case("same table twice", 2, with_obstacles(page_on_table, table, table), same),
        Case("same table ten times", 10, with_obstacles(page_on_table, *[table] * 10), same),
        Case("rough and smooth table", 2, with_obstacles(page_on_table, table, smooth), same),
        Case("page in a corner", 2, with_obstacles(page_on_table, table, page_wall), same),
        Case("same floor twice", 2, with_obstacles(sheet_on_floor, floor, floor), flat),
        Case("floor and wall", 2, with_obstacles(sheet_on_floor, floor, wall), flat),
        Case("floor and ceiling", 2, with_obstacles(sheet_on_floor, floor, slit), squeezed),
        Case(
            "ceiling only",
            1,
            with_obstacles(sheet_on_floor, slit),
            only(S.INFEASIBLE, because="a ceiling cannot pull"),
        ),
        Case(
            "smooth floor and wall",
            2,
            with_obstacles(
                sheet_on_floor, replace(floor, friction=0.0), replace(wall, friction=0.0)
            ),
            Expected(
                SOFT | {S.INFEASIBLE}, "a wall that must push has nothing against it: pull is zero"
            ),
        ),
    ]
