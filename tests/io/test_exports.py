"""Exports parsed back and compared; signs and orders of other programs from their own words."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_scenes import clamped_page

from casashell.io.exports import export, newton_order, triangle_poses
from casashell.io.exports_text import NEWTON_SCRIPT, VELLUM_SCRIPT
from casashell.io.meshes import read_mesh
from casashell.mesh import TriMesh
from casashell.metric import Metric
from casashell.result import Result
from casashell.solving import solve
from casashell.typing import AnyArray, FloatArray


@pytest.fixture(scope="module")
def page() -> Result:
    return solve(clamped_page(), natural="metric", interpreted=True)


def _angle_of_newton(x: FloatArray, row: list[int]) -> float:
    """Newton's words: triangles (o0, v0, v1) and (o1, v1, v0), sine along v1 - v0."""
    o0, o1, v0, v1 = (x[i] for i in row)
    first, second = np.cross(v0 - o0, v1 - o0), np.cross(v1 - o1, v0 - o1)
    first, second = first / np.linalg.norm(first), second / np.linalg.norm(second)
    edge = (v1 - v0) / np.linalg.norm(v1 - v0)
    return float(np.arctan2(np.cross(first, second) @ edge, first @ second))


def test_newton_orders_and_signs_are_those_of_its_bending_elements(page: Result) -> None:
    """The natural mesh gives, by Newton's own formula, the angles and lengths that are exported."""
    metric = Metric.of(page.target, page.rest)
    rows = newton_order(metric.hinges)
    angles = [_angle_of_newton(page.rest, row) for row in rows.tolist()]
    assert np.abs(metric.rest_angle).max() > 0.1  # curved: a wrong sign would show
    np.testing.assert_allclose(angles, metric.rest_angle, atol=1e-12)


def test_a_fold_away_from_the_normals_is_positive() -> None:
    """Closed form: two right triangles over the x axis, both wings 45 degrees below, normals up."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0.5, 1, -1], [0.5, -1, -1]], dtype=float)
    metric = Metric.of(TriMesh(points, [[0, 1, 2], [1, 0, 3]]), points)
    np.testing.assert_allclose(metric.rest_angle, [np.pi / 2], rtol=1e-15)


def test_newton_file_parsed_back(page: Result, tmp_path: Path) -> None:
    assert page.metric is not None
    assert export(page, "newton", tmp_path) == ("newton.npz", "load_newton.py")
    with np.load(tmp_path / "newton.npz") as arrays:
        rows = arrays["edge_indices"]
        np.testing.assert_array_equal(rows[:, [2, 3, 0, 1]], page.metric.hinges)
        np.testing.assert_array_equal(arrays["edge_rest_angle"], page.metric.rest_angle)
        shared = np.linalg.norm(page.rest[rows[:, 3]] - page.rest[rows[:, 2]], axis=1)
        np.testing.assert_allclose(arrays["edge_rest_length"], shared, rtol=1e-14)
        np.testing.assert_array_equal(arrays["spring_rest_length"], page.metric.rest_length)
        np.testing.assert_array_equal(arrays["tri_areas"], page.metric.rest_area)


def test_triangle_poses_undo_the_rest_edges(page: Result) -> None:
    """Their inverses have the lengths and the angle of the two rest edges at corner 0."""
    a, b, c = (page.rest[page.target.faces[:, corner]] for corner in range(3))
    flat = np.linalg.inv(triangle_poses(page.target, Metric.of(page.target, page.rest)))
    np.testing.assert_allclose(flat[:, 1, 0], 0.0, atol=1e-15)
    gram = np.einsum("fki,fkj->fij", flat, flat)
    edges = np.stack([b - a, c - a], axis=2)
    np.testing.assert_allclose(gram, np.einsum("fki,fkj->fij", edges, edges), atol=1e-12)


class _Held:
    """An array of a simulator that is read as NumPy and assigned to."""

    def __init__(self, values: AnyArray) -> None:
        self.values = np.array(values)

    def numpy(self) -> AnyArray:
        return self.values.copy()

    def assign(self, values: AnyArray) -> None:
        self.values = np.array(values)


@dataclass
class _NewtonModel:
    edge_indices: _Held
    edge_rest_angle: _Held
    edge_rest_length: _Held
    tri_poses: _Held
    tri_areas: _Held


def test_the_newton_loader_matches_elements_in_any_order(page: Result, tmp_path: Path) -> None:
    """A model in another order, ends exchanged (with the sides: the same element; alone: turned)."""
    export(page, "newton", tmp_path)
    namespace: dict[str, Any] = {}
    exec(NEWTON_SCRIPT, namespace)
    with np.load(tmp_path / "newton.npz") as file:
        arrays = dict(file)
    rng = np.random.default_rng(3)
    rows = arrays["edge_indices"][rng.permutation(len(arrays["edge_indices"]))]
    rows[::3] = rows[::3][:, [1, 0, 3, 2]]
    rows[1::3] = rows[1::3][:, [0, 1, 3, 2]]
    border = np.array([[5, -1, 0, 1]])
    edges = np.vstack([rows, border])
    count = len(page.target.faces)
    model = _NewtonModel(
        _Held(edges),
        _Held(np.full(len(edges), 9.0)),
        _Held(np.full(len(edges), 9.0)),
        _Held(np.zeros((count, 2, 2))),
        _Held(np.zeros(count)),
    )
    namespace["apply"](model, arrays)
    wanted = [_angle_of_newton(page.rest, row) for row in rows.tolist()]
    np.testing.assert_allclose(model.edge_rest_angle.values[:-1], wanted, atol=1e-12)
    assert model.edge_rest_angle.values[-1] == 9.0
    np.testing.assert_array_equal(model.tri_areas.values, arrays["tri_areas"])


@dataclass
class _Point:
    at: int

    def number(self) -> int:
        return self.at


@dataclass
class _Vertex:
    at: int

    def point(self) -> _Point:
        return _Point(self.at)


@dataclass
class _Constraint:
    points: list[int]
    value: float

    def vertices(self) -> Iterator[_Vertex]:
        return (_Vertex(point) for point in self.points)

    def attribValue(self, name: str) -> float:
        assert name == "restlength"
        return self.value

    def setAttribValue(self, name: str, value: float) -> None:
        assert name == "restlength"
        self.value = value


@dataclass
class _Geometry:
    constraints: list[_Constraint]

    def prims(self) -> list[_Constraint]:
        return self.constraints


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_vellum_script_sets_lengths_and_degrees(
    page: Result, tmp_path: Path, sign: float
) -> None:
    """Stand-ins for Houdini's primitives; whichever sign it gives the angles of the pose."""
    assert page.metric is not None
    export(page, "vellum", tmp_path)
    namespace: dict[str, Any] = {}
    exec(VELLUM_SCRIPT, namespace)
    pose = Metric.of(page.target, page.pose)
    edges = [_Constraint(edge[::-1], 0.0) for edge in page.metric.edges.tolist()]
    bends = [
        _Constraint([k, i, j, side], sign * float(np.degrees(angle)))
        for (i, j, k, side), angle in zip(pose.hinges.tolist(), pose.rest_angle, strict=True)
    ]
    namespace["apply"](_Geometry(bends[::-1] + edges), str(tmp_path))
    np.testing.assert_array_equal([c.value for c in edges], page.metric.rest_length)
    np.testing.assert_allclose(
        np.radians([c.value for c in bends]), sign * page.metric.rest_angle, atol=1e-12
    )


def test_vellum_tables_parsed_back(page: Result, tmp_path: Path) -> None:
    assert page.metric is not None
    export(page, "vellum", tmp_path)
    with (tmp_path / "vellum_bend.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    np.testing.assert_allclose(
        np.radians([float(row["restangle"]) for row in rows]), page.metric.rest_angle, atol=1e-14
    )
    names = ("edge0", "edge1", "side0", "side1")
    assert [[int(row[n]) for n in names] for row in rows] == page.metric.hinges.tolist()


def test_blender_meshes_parsed_back(page: Result, tmp_path: Path) -> None:
    names = export(page, "blender", tmp_path)
    assert names == ("load_blender.py", "pose.obj", "rest.obj")
    rest, pose = read_mesh(tmp_path / "rest.obj"), read_mesh(tmp_path / "pose.obj")
    np.testing.assert_array_equal(rest.vertices, page.rest)
    np.testing.assert_array_equal(pose.vertices, page.pose)
    np.testing.assert_array_equal(rest.faces, pose.faces)
    compile((tmp_path / "load_blender.py").read_text(), "load_blender.py", "exec")


def test_plain_arrays_parsed_back(page: Result, tmp_path: Path) -> None:
    assert page.metric is not None
    export(page, "npz", tmp_path)
    with np.load(tmp_path / "rest.npz") as arrays:
        np.testing.assert_array_equal(arrays["rest_angle"], page.metric.rest_angle)
        np.testing.assert_array_equal(arrays["rest"], page.rest)


def test_what_cannot_be_exported_is_refused(page: Result, tmp_path: Path) -> None:
    assert page.metric is not None
    with pytest.raises(ValueError, match="newton, vellum, blender, npz"):
        export(page, "maya", tmp_path)
    loose = replace(page, metric=replace(page.metric, embedded=False))
    with pytest.raises(ValueError, match="no mesh has"):
        export(loose, "blender", tmp_path)
    export(loose, "npz", tmp_path)
    with np.load(tmp_path / "rest.npz") as arrays:
        assert "rest" not in arrays
    broken = replace(page, metric=None, rest=np.full_like(page.rest, np.nan))
    with pytest.raises(ValueError, match="no natural shape"):
        export(broken, "npz", tmp_path)
