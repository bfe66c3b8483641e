"""Terms of the energy of a ribbon, from its numbers and the physics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from casashell.ribbon.chain import BOTTOM, COORDINATES, NORMAL, TOP
from casashell.ribbon.physics import RibbonPhysics
from casashell.ribbon.ribbon import Ribbon
from casashell.ribbon.terms import Term
from casashell.typing import ArrayLike, FloatArray, IntArray


def quads(segments: int) -> IntArray:
    """(N,6) rows (c, c, b, b, t, t) of the station table, for every quad."""
    first = 4 * np.arange(segments)[:, None]
    return first + np.array(
        [COORDINATES, 4 + COORDINATES, BOTTOM, 4 + BOTTOM, TOP, 4 + TOP], dtype=np.int64
    )


def ends(segments: int) -> IntArray:
    """(1,6) rows (b_0, t_0, n_0, b_N, t_N, n_N)."""
    here = np.array([BOTTOM, TOP, NORMAL], dtype=np.int64)
    return np.concatenate([here, 4 * segments + here])[None]


def bending(ribbon: Ribbon, physics: RibbonPhysics) -> Term:
    """Bending of all creases; the extra ones at the ends stand for half a segment."""
    stations = np.flatnonzero(ribbon.bends)
    n, step = ribbon.segments, ribbon.segment
    natural = np.concatenate([[ribbon.rest_start], ribbon.rest_angles, [ribbon.rest_end]])
    share = np.where((stations == 0) | (stations == n), 0.5, 1.0) * step
    params = np.empty((len(stations), 4))
    params[:, 0], params[:, 1], params[:, 2] = ribbon.stiffness, ribbon.width, share
    params[:, 3] = natural[stations]
    if ribbon.energy == "sadowsky":
        return Term(physics.sadowsky, 4 * stations[:, None], params)
    around = np.stack([np.maximum(stations - 1, 0), stations, np.minimum(stations + 1, n)], axis=1)
    span = step * (around[:, 2] - around[:, 0])
    return Term(physics.wunderlich, 4 * around, np.column_stack([params, span]))


def rulings(ribbon: Ribbon, physics: RibbonPhysics) -> Term:
    """Regulariser: m D W l / (2 L^2) sum (c - cbar)^2 over the inner rulings."""
    stations = np.arange(1, ribbon.segments)
    weight = ribbon.regulariser * ribbon.stiffness * ribbon.width * ribbon.segment
    params = np.empty((len(stations), 2))
    params[:, 0], params[:, 1] = weight / ribbon.length**2, ribbon.target_rulings
    return Term(physics.rulings, 4 * stations[:, None], params)


def hesitant(ribbon: Ribbon, physics: RibbonPhysics, weight: float, slopes: FloatArray) -> Term:
    """weight D W / (2 l) sum (c - slopes)^2 over the inner rulings; slopes (N+1,)."""
    stations = np.arange(1, ribbon.segments)
    params = np.column_stack([np.full(len(stations), weight * ribbon.energy_unit), slopes[1:-1]])
    return Term(physics.rulings, 4 * stations[:, None], params)


def gravity(ribbon: Ribbon, physics: RibbonPhysics, acceleration: ArrayLike) -> Term:
    """Weight, exact for the planar quads; ``acceleration`` (3,) [m/s2].  ValueError if not finite."""
    g = vector("gravity", acceleration)
    row = np.array([ribbon.density, ribbon.segment, ribbon.width, *g])
    return Term(physics.gravity, quads(ribbon.segments), np.tile(row, (ribbon.segments, 1)))


def guiding(
    ribbon: Ribbon,
    physics: RibbonPhysics,
    segments: Sequence[int],
    normals: ArrayLike,
    weight: float,
) -> Term:
    """weight/2 |n - nstar|^2 [J] for the quads ``segments``, nstar (3,) or one for each.

    No force at n = -nstar: move nstar by less than a right angle at a time.
    """
    which = np.asarray(segments, dtype=np.int64)
    wrong = which[(which < 0) | (which >= ribbon.segments)]
    if wrong.size:
        raise ValueError(f"guided segment {wrong[0]}: the ribbon has 0 .. {ribbon.segments - 1}")
    wanted = np.broadcast_to(np.asarray(normals, dtype=np.float64), (len(which), 3))
    size = np.linalg.norm(wanted, axis=1)
    if not np.all(np.abs(size - 1.0) < 1e-6):
        raise ValueError("guided normals must be unit vectors")
    if not (np.isfinite(weight) and weight >= 0):
        raise ValueError(f"weight of the guided normals must be finite and >= 0, got {weight}")
    params = np.column_stack([np.full(len(which), weight), wanted])
    return Term(physics.guiding, 4 * which[:, None] + NORMAL, params)


@dataclass(frozen=True, eq=False)
class PointLoad:
    """Dead force (3,) [N] at the material point (s, y): s from the begin, y from the centreline [m]."""

    s: float
    y: float
    force: ArrayLike

    def __post_init__(self) -> None:
        object.__setattr__(self, "force", vector("force", self.force))


def load(
    ribbon: Ribbon, physics: RibbonPhysics, point: PointLoad, slopes: FloatArray | None = None
) -> Term:
    """The load, on the quad that holds its point when the rulings have ``slopes`` (N+1,)."""
    quad, place = material(ribbon, point.s, point.y, slopes)
    params = np.concatenate([np.asarray(point.force), place])[None]
    return Term(physics.load, quads(ribbon.segments)[quad : quad + 1], params)


def material(
    ribbon: Ribbon, s: float, y: float, slopes: FloatArray | None = None
) -> tuple[int, FloatArray]:
    """Quad that holds a material point, and (s, y, begin, l, W); slopes (N+1,), None for all 0.

    Raises ValueError for a point outside of the strip.
    """
    half = 0.5 * ribbon.width
    if not (0 <= s <= ribbon.length and -half <= y <= half):
        raise ValueError(
            f"material point ({s:g}, {y:g}) lies outside of the strip: s within 0 and "
            f"{ribbon.length:g}, y within {-half:g} and {half:g}"
        )
    begins = ribbon.segment * np.arange(ribbon.segments)
    crossed = begins if slopes is None else begins + slopes[:-1] * y
    quad = max(int(np.searchsorted(crossed, s, side="right")) - 1, 0)
    return quad, np.array([s, y, begins[quad], ribbon.segment, ribbon.width])


def custom(
    ribbon: Ribbon,
    energy: Callable[[ca.SX, ca.SX, ca.SX, ca.SX, ca.SX], ca.SX],
    stations: Sequence[int] | None = None,
) -> Term:
    """Any energy of single stations: ``energy(c, beta, bottom, top, normal)`` -> J in CasADi symbols.

    bottom, top and normal are (3,) symbols; all stations 0 .. N by default.  For energies of several
    stations make a `Term` of a density.  Raises ValueError for stations outside of the ribbon and for
    an energy that is no number.
    """
    x, r, p = ca.SX.sym("x", 3, 4), ca.SX.sym("r", 3, 4), ca.SX.sym("p", 1)
    value = ca.SX(energy(x[0, 0], x[1, 0], x[:, 1], x[:, 2], x[:, 3]))
    if value.shape != (1, 1):
        raise ValueError(f"an energy must be one number, got shape {value.shape}")
    wanted = range(ribbon.segments + 1) if stations is None else stations
    which = np.asarray(wanted, dtype=np.int64)
    wrong = which[(which < 0) | (which > ribbon.segments)]
    if wrong.size:
        raise ValueError(f"station {wrong[0]}: the ribbon has 0 .. {ribbon.segments}")
    rows = np.array([COORDINATES, BOTTOM, TOP, NORMAL], dtype=np.int64)
    density = ca.Function("ribbon_custom", [x, r, p], [value])
    return Term(density, 4 * which[:, None] + rows, np.zeros((len(which), 1)))


def elastic(ribbon: Ribbon, physics: RibbonPhysics) -> tuple[Term, ...]:
    """What every ribbon has: bending, and the regulariser unless its weight is 0."""
    terms: tuple[Term, ...] = (bending(ribbon, physics),)
    return (*terms, rulings(ribbon, physics)) if ribbon.regulariser > 0 else terms


def vector(name: str, value: ArrayLike) -> FloatArray:
    """``value`` as a finite vector (3,), or ValueError."""
    made = np.array(value, dtype=np.float64)
    if made.shape != (3,):
        raise ValueError(f"{name} must be three finite numbers, got {value!r}")
    if not np.all(np.isfinite(made)):
        at = int(np.flatnonzero(~np.isfinite(made))[0])
        raise ValueError(f"{name} must be three finite numbers, its {'xyz'[at]} is {made[at]}")
    return made


def junction(ribbon: Ribbon, physics: RibbonPhysics) -> Term:
    """Bending of the crease where the ends of a closed ribbon are joined."""
    side = -1.0 if ribbon.ends == "moebius" else 1.0
    row = np.array([ribbon.stiffness, ribbon.width, ribbon.segment, 0.0, side])
    return Term(physics.junction, ends(ribbon.segments), row[None])
