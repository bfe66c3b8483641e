"""A natural metric: rest lengths, rest angles and rest areas, with or without a mesh that has them.

Edge and hinge simulators store just these numbers, so a natural shape need not exist in space to be of
use to them.  The areas are those of the triangles the rest lengths make (Heron).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import casadi as ca
import numpy as np

from casashell.engine.energy import Energy, MetricForm
from casashell.mesh import TriMesh
from casashell.strain import dihedral_angles
from casashell.typing import AnyArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Metric:
    """Natural lengths, angles and areas of a mesh.

    edges, rest_length  (E,2), (E,) m; the edges are those of the mesh
    hinges, rest_angle  (H,4), (H,) rad: the two edge ends, then the opposite vertices.  Zero is flat,
                        positive folds away from the side the normals point to; beyond +-pi the
                        hinge wants to turn on past itself
    rest_area           (F,) m2
    embedded            whether they are those of a mesh in space, the natural mesh of the result
    """

    edges: IntArray
    rest_length: FloatArray
    hinges: IntArray
    rest_angle: FloatArray
    rest_area: FloatArray
    embedded: bool = True

    @staticmethod
    def of(mesh: TriMesh, rest: FloatArray) -> Metric:
        """The metric of the natural positions ``rest`` (V,3) m of ``mesh``."""
        shape = mesh.moved(rest)
        angles = dihedral_angles(rest, mesh.hinges)
        return Metric(mesh.edges, shape.edge_lengths, mesh.hinges, angles, shape.face_areas)

    def corner_angles(self, mesh: TriMesh) -> FloatArray:
        """Natural angles (F,3) of every corner of the faces of ``mesh`` [rad]."""
        sides = self.rest_length[MetricIndex(mesh).sides]
        squares = sides**2
        cosine = squares.sum(axis=1, keepdims=True) - 2.0 * squares  # times two adjacent sides
        return np.asarray(np.arctan2(4.0 * heron(sides)[:, None], cosine))


def heron(sides: FloatArray) -> FloatArray:
    """Areas (F,) of triangles with sides (F,3); 0 where the triangle inequality fails.

    Kahan's arrangement, which is accurate for needles too.
    """
    c, b, a = np.sort(sides, axis=1).T
    product = (a + (b + c)) * (c - (a - b)) * (c + (a - b)) * (a + (b - c))
    return np.asarray(0.25 * np.sqrt(np.maximum(product, 0.0)))


def laid_out(mesh: TriMesh, metric: Metric) -> Metric:
    """The metric with its areas from triangles laid out in the plane, for a check without Heron.

    NaN where three rest lengths make no triangle.
    """
    a, b, c = metric.rest_length[MetricIndex(mesh).sides].T
    along = (b**2 + c**2 - a**2) / (2.0 * c)
    with np.errstate(invalid="ignore"):
        height = np.sqrt((b - along) * (b + along))
    return replace(metric, rest_area=np.where(height > 0.0, 0.5 * c * height, np.nan))


def thinness(sides: FloatArray) -> FloatArray:
    """(shorter + middle - longest) / longest of triangles with sides (F,3); negative: no triangle."""
    ordered = np.sort(sides, axis=1)
    return np.asarray((ordered[:, 0] + ordered[:, 1] - ordered[:, 2]) / ordered[:, 2])


@dataclass(frozen=True, eq=False)
class MetricIndex:
    """Finds lengths, areas and angles of a mesh by vertices."""

    mesh: TriMesh

    @cached_property
    def sides(self) -> IntArray:
        """Edges (F,3) of every face, each opposite to the corner of its column."""
        faces = self.mesh.faces
        pairs = [faces[:, [(c + 1) % 3, (c + 2) % 3]] for c in range(3)]
        return np.stack([self.edges(pair) for pair in pairs], axis=1)

    @cached_property
    def _edge_keys(self) -> IntArray:
        return self._keys(self.mesh.edges)

    @cached_property
    def _face_keys(self) -> tuple[IntArray, IntArray]:
        keys = self._keys(self.mesh.faces)
        order = np.argsort(keys)
        return keys[order], order

    def _keys(self, vertices: IntArray) -> IntArray:
        """One number per set of vertices."""
        key = np.zeros(len(vertices), dtype=np.int64)
        for column in np.sort(vertices, axis=1).T:
            key = key * len(self.mesh.vertices) + column
        return key

    def edges(self, pairs: IntArray) -> IntArray:
        """Numbers of the edges (n,2)."""
        return _found(self._edge_keys, self._keys(pairs), "edge", pairs)

    def faces(self, corners: IntArray) -> IntArray:
        """Numbers of the faces (n,3), in whatever order their corners are."""
        keys, order = self._face_keys
        return np.asarray(order[_found(keys, self._keys(corners), "face", corners)])

    def hinges(self, stencils: IntArray) -> IntArray:
        """Numbers of the hinges (n,4)."""
        keys = self._keys(self.mesh.hinges[:, :2])
        return _found(keys, self._keys(stencils[:, :2]), "hinge", stencils)

    def locate(self, read: tuple[int, ...], stencils: IntArray) -> IntArray:
        """Numbers (S,) of the length, area or angle that ``read`` names in stencils (S,k)."""
        finders = {2: self.edges, 3: self.faces, 4: self.hinges}
        return finders[len(read)](stencils[:, read])

    def numbers(self, form: MetricForm, stencils: IntArray, metric: Metric) -> FloatArray:
        """Natural numbers (S,m) of stencils (S,k) of a term."""
        kinds = {2: metric.rest_length, 3: metric.rest_area, 4: metric.rest_angle}
        columns = [kinds[len(read)][self.locate(read, stencils)] for read in form.reads]
        return np.stack(columns, axis=1) if columns else np.empty((len(stencils), 0))


def _found(known: IntArray, wanted: IntArray, kind: str, vertices: IntArray) -> IntArray:
    if len(wanted) == 0:
        return np.empty(0, dtype=np.int64)
    place = np.minimum(np.searchsorted(known, wanted), len(known) - 1)
    missing = np.flatnonzero(known[place] != wanted) if len(known) else np.arange(len(wanted))
    if missing.size:
        raise ValueError(
            f"the mesh has no {kind} with vertices {vertices[missing[0]].tolist()}: "
            "was the energy built for another mesh?"
        )
    return np.asarray(place)


def require_forms(energies: Sequence[Energy]) -> None:
    """Raise ValueError naming the first term that cannot take a natural metric."""
    for term in energies:
        if term.metric is None:
            raise ValueError(
                f"energy '{term.name}' has no metric form, so it cannot take natural lengths and "
                "angles: give it Energy.metric or ask for a natural mesh"
            )


@cache
def _with_numbers(density: str, measure: str | None, k: int, m: int) -> ca.Function:
    """Density (x, r, (p, n)) of a term whose natural numbers n (m,) are parameters."""
    form = ca.Function.deserialize(density)
    x, r = ca.SX.sym("x", 3, k), ca.SX.sym("r", 3, k)
    p = ca.SX.sym("p", form.numel_in(2) + m)
    of = x if measure is None else ca.Function.deserialize(measure)(x)
    own, n = p[: form.numel_in(2)], p[form.numel_in(2) :]
    return ca.Function(form.name(), [x, r, p], [form(of, n, own)])


def with_metric(energies: Sequence[Energy], mesh: TriMesh, metric: Metric) -> tuple[Energy, ...]:
    """The same terms with the natural numbers of ``metric``; natural positions no longer matter.

    Raises ValueError for a term that has no metric form.
    """
    require_forms(energies)
    index = MetricIndex(mesh)
    return tuple(_bound(term, index, metric) for term in energies)


def _bound(term: Energy, index: MetricIndex, metric: Metric) -> Energy:
    form = term.metric
    if form is None:
        raise ValueError(f"energy '{term.name}' has no metric form")
    numbers, own = index.numbers(form, term.stencils, metric), term.params.shape[1]

    def reference(_: AnyArray, p: AnyArray) -> Callable[[AnyArray], AnyArray]:
        return form.reference(p[own:], p[:own])

    measure = None if term.measure is None else term.measure.serialize()
    moved = form.in_motion
    if moved is not None:
        moved = _with_numbers(moved.serialize(), None, term.size, len(form.reads))
    return replace(
        term,
        density=_with_numbers(form.density.serialize(), measure, term.size, len(form.reads)),
        params=np.hstack([term.params, numbers]),
        reference=reference,
        metric=None,
        in_motion=moved,
    )
