"""Every kind of finding on the smallest mesh that has it, with the ids it must name."""

from __future__ import annotations

import numpy as np
import pytest
from tiny_meshes import SQUARE, SQUARE_FACES, grid, moebius_band

from casashell.mesh import TriMesh
from casashell.mesh_checks import Finding, MeshError, inspect_mesh, validate

UP = np.array([0.0, 0.0, 1.0])


def sliver(degrees: float) -> TriMesh:
    """The square beside a triangle whose smallest angle is the given one, on the edge x = 1."""
    height = np.tan(np.radians(degrees)) / 2  # two angles of `degrees` over a side of length 1
    tip = [1 + height, 0.5, 0]
    # the two small angles have tan = height / 0.5, so the given angle exactly
    return TriMesh(np.vstack([SQUARE, [tip]]), np.vstack([SQUARE_FACES, [[2, 1, 4]]]))


CASES: dict[str, tuple[TriMesh, str, str, list[object]]] = {
    "three faces on an edge": (
        TriMesh(np.vstack([SQUARE, UP, UP + 1]), np.vstack([SQUARE_FACES, [[0, 2, 4], [2, 0, 5]]])),
        "non_manifold_edge",
        "error",
        [[0, 2]],
    ),
    "bow tie": (
        TriMesh(
            [[-1, -1, 0], [-1, 1, 0], [0, 0, 0], [1, -1, 0], [1, 1, 0]], [[0, 2, 1], [2, 3, 4]]
        ),
        "non_manifold_vertex",
        "warning",
        [2],
    ),
    "two pieces": (
        TriMesh(np.vstack([SQUARE, SQUARE + UP]), np.vstack([SQUARE_FACES, SQUARE_FACES + 4])),
        "components",
        "warning",
        [0, 2],
    ),
    "a face turned over": (
        TriMesh(grid(3).vertices, np.vstack([grid(3).faces[:7], grid(3).faces[7:, ::-1]])),
        "inconsistent_orientation",
        "error",
        [7],
    ),
    "Moebius band": (moebius_band(3), "one_sided", "error", [0, 1, 2, 3, 4, 5]),
    "collinear face": (
        TriMesh(np.vstack([SQUARE, [[1, 0.3, 0]]]), np.vstack([SQUARE_FACES, [[2, 1, 4]]])),
        "degenerate_face",
        "error",
        [2],
    ),
    "repeated corner": (
        TriMesh(SQUARE, np.vstack([SQUARE_FACES, [[2, 3, 3]]])),
        "degenerate_face",
        "error",
        [2],
    ),
    "copied face": (
        TriMesh(SQUARE, np.vstack([SQUARE_FACES, [[1, 2, 0]]])),
        "duplicate_face",
        "error",
        [2],
    ),
    "needle": (sliver(0.09), "sliver", "error", [2]),
    "thin face": (sliver(0.11), "sliver", "warning", [2]),
    "lone vertex": (
        TriMesh(np.vstack([SQUARE, UP]), SQUARE_FACES),
        "unreferenced_vertex",
        "error",
        [4],
    ),
    "open seam": (
        TriMesh(
            np.vstack([SQUARE, SQUARE + np.array([1, 0, 0])]),
            np.vstack([SQUARE_FACES, SQUARE_FACES + 4]),
        ),
        "coincident_vertices",
        "warning",
        [1, 2, 4, 7],
    ),
    "pierced": (
        TriMesh(
            np.vstack([SQUARE, [[0.6, 0.2, -1], [0.5, 0.1, 1], [0.7, 0.3, 1]]]),
            np.vstack([SQUARE_FACES, [[4, 5, 6]]]),
        ),
        "self_intersection",
        "warning",
        [[0, 2]],
    ),
}


def only(findings: tuple[Finding, ...], kind: str) -> Finding:
    found = [finding for finding in findings if finding.kind == kind]
    assert len(found) == 1, [finding.kind for finding in findings]
    return found[0]


@pytest.mark.parametrize("case", CASES)
def test_fault_is_found_with_its_ids_and_a_next_step(case: str) -> None:
    mesh, kind, severity, ids = CASES[case]
    finding = only(inspect_mesh(mesh), kind)
    assert finding.severity == severity
    assert finding.ids.tolist() == ids
    first = str(ids[0]) if isinstance(ids[0], int) else "-".join(map(str, ids[0]))  # type: ignore
    assert first in finding.message
    assert ";" in finding.message or ":" in finding.message  # the next step follows
    if severity == "error":
        with pytest.raises(MeshError, match="(?s)" + finding.message[:20].replace("(", r"\(")):
            validate(mesh)
    else:
        assert kind in [finding.kind for finding in validate(mesh)]


@pytest.mark.parametrize("mesh", [grid(6), grid(2), sliver(1.01)])
def test_sound_meshes_have_no_findings(mesh: TriMesh) -> None:
    assert inspect_mesh(mesh) == ()
    assert validate(mesh) == ()


def test_a_fault_is_reported_once() -> None:
    mesh, *_ = CASES["repeated corner"]
    assert [finding.kind for finding in inspect_mesh(mesh)] == ["degenerate_face"]
    mesh, *_ = CASES["collinear face"]
    assert "sliver" not in [finding.kind for finding in inspect_mesh(mesh)]


def test_error_carries_all_findings_errors_first() -> None:
    lone = np.vstack([SQUARE, SQUARE + UP, [[9, 9, 9]]])
    mesh = TriMesh(lone, np.vstack([SQUARE_FACES, SQUARE_FACES + 4, [[4, 4, 5]]]))
    with pytest.raises(MeshError) as caught:
        validate(mesh)
    kinds = [finding.kind for finding in caught.value.findings]
    assert kinds == ["degenerate_face", "unreferenced_vertex", "components"]
    assert str(caught.value).count("\n") == 1
    assert "separate pieces" not in str(caught.value)


def test_long_lists_are_cut_in_the_message_only() -> None:
    mesh = grid(5)
    vertices = np.vstack([mesh.vertices, np.arange(60).reshape(20, 3) + 100.0])
    finding = only(inspect_mesh(TriMesh(vertices, mesh.faces)), "unreferenced_vertex")
    assert finding.ids.tolist() == list(range(25, 45))
    assert "20 vertices in no face (25, 26, 27, 28, 29, ...)" in finding.message


def test_self_intersections_may_be_left_out() -> None:
    mesh, *_ = CASES["pierced"]
    kinds = [finding.kind for finding in inspect_mesh(mesh, self_intersections=False)]
    assert kinds == ["components"]
