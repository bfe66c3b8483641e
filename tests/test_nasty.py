"""Real garments with real faults, as their authors published them: what becomes of each."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from casashell.io.meshes import read_mesh_file, write_mesh
from casashell.mesh import TriMesh
from casashell.mesh_checks import Finding, MeshError, inspect_mesh, validate
from casashell.repair import repaired

GARMENTS = [
    "brimmed_hat_avatar",
    "dress_avatar",
    "hat_on_sphere",
    "knit_cap_avatar",
    "long_skirt_makehuman",
    "pants_avatar",
    "sheet_on_slope_576",
    "shirt_avatar",
    "skirt_4panel_smpl",
    "skirt_8panel_smpl",
    "sleeve_avatar",
    "top_avatar",
]


@dataclass(frozen=True)
class Expected:
    """Counts of ids per kind of finding.  The counts marked * are in the collection's table."""

    shape: tuple[int, int]  # vertices and faces as read *
    errors: dict[str, int] = field(default_factory=dict)
    warnings: dict[str, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()  # how the reading notes start
    actions: tuple[str, ...] = ()  # how the lines of the repair report start
    repaired_shape: tuple[int, int] | None = None  # if the repair changes the mesh
    left: tuple[str, ...] = ()  # kinds of errors after the repair


EXPECTED = {
    # 11 edges with three faces * stay: which layer to cut is for its owner to say.  Of the 37
    # conflicting edges * 26 lie between two faces, around 272 faces wound the wrong way
    "polo.obj": Expected(
        shape=(3314, 6508),
        errors={"non_manifold_edge": 11, "inconsistent_orientation": 272},
        actions=("turned over 272 faces", "still wrong: 11 edges"),
        repaired_shape=(3314, 6508),
        left=("non_manifold_edge",),
    ),
    # 42 edges with three faces *, nothing else: the two layers of a trim sewn to the suit
    "swimming03.obj": Expected(
        shape=(785, 1438),
        errors={"non_manifold_edge": 42},
        warnings={"self_intersection": 11},
        notes=("719 quads",),
        actions=("still wrong: 42 edges",),
        left=("non_manifold_edge",),
    ),
    # 65 vertices doubled *, between them 109 faces without area *: the weld closes those.  The belt
    # loops also have vertices 1e-6 apart (see the next test), hence the slivers
    "pants01.obj": Expected(
        shape=(1599, 2996),
        errors={"degenerate_face": 109, "sliver": 41},
        warnings={"components": 6, "coincident_vertices": 130, "self_intersection": 140},
        notes=("1498 quads",),
        actions=("welded 65 vertices", "dropped 109 faces", "still wrong: 41 faces"),
        repaired_shape=(1534, 2887),
        left=("sliver",),
    ),
    # proper surface, folded with crossing layers (119 edges through faces *): the user may go on
    "tshirt1900-folding-triFolded.obj": Expected(
        shape=(1921, 3726),
        warnings={"self_intersection": 117},
    ),
    # smallest angle 0.0097 degrees *: no repair without moving vertices
    "dress.ply": Expected(
        shape=(4072, 8106),
        errors={"sliver": 15},
        warnings={"sliver": 59},
        actions=("still wrong: 15 faces with an angle below 0.1 degrees",),
        left=("sliver",),
    ),
    # six vertices in no face and a stray line: dropped, and the hat is sound
    "agenthat2.obj": Expected(
        shape=(851, 1616),
        errors={"unreferenced_vertex": 6},
        notes=("1 line element was ignored",),
        actions=("dropped 6 vertices",),
        repaired_shape=(845, 1616),
    ),
}


def counts(findings: tuple[Finding, ...], severity: str) -> dict[str, int]:
    return {f.kind: len(f.ids) for f in findings if f.severity == severity}


def starts(lines: tuple[str, ...], beginnings: tuple[str, ...]) -> bool:
    return len(lines) == len(beginnings) and all(map(str.startswith, lines, beginnings))


@pytest.mark.parametrize("name", EXPECTED)
def test_file_is_read_and_judged_as_written_down(shared_data: Path, name: str) -> None:
    expected = EXPECTED[name]
    held = read_mesh_file(shared_data / "nasty" / name)
    assert (len(held.mesh.vertices), len(held.mesh.faces)) == expected.shape
    assert starts(held.notes, expected.notes), held.notes
    findings = inspect_mesh(held.mesh)
    assert counts(findings, "error") == expected.errors
    assert counts(findings, "warning") == expected.warnings
    if expected.errors:
        with pytest.raises(MeshError):
            validate(held.mesh)
    else:
        assert [f.kind for f in validate(held.mesh)] == list(expected.warnings)


@pytest.mark.parametrize("name", EXPECTED)
def test_repair_does_what_is_written_down_and_no_more(shared_data: Path, name: str) -> None:
    expected = EXPECTED[name]
    mesh = read_mesh_file(shared_data / "nasty" / name).mesh
    repair = repaired(mesh)
    assert starts(repair.report, expected.actions), repair.report
    if expected.repaired_shape is None:
        assert repair.mesh is mesh
    assert (len(repair.mesh.vertices), len(repair.mesh.faces)) == (
        expected.repaired_shape or expected.shape
    )
    assert tuple(counts(repair.remaining, "error")) == expected.left
    assert repair.sound == (not expected.left)
    kept = repair.vertex_map >= 0
    np.testing.assert_array_equal(
        repair.mesh.vertices[repair.vertex_map[kept]], mesh.vertices[kept]
    )


def test_belt_loops_of_the_trousers_close_with_a_tolerance(
    shared_data: Path, tmp_path: Path
) -> None:
    mesh = read_mesh_file(shared_data / "nasty" / "pants01.obj").mesh
    repair = repaired(mesh, tolerance=1e-5)  # the file has six decimals, in decimetres
    assert repair.sound
    assert [f.kind for f in validate(repair.mesh)] == ["components", "self_intersection"]
    assert repair.mesh.topology.face_components[0] == 6
    # 75 quads lie between doubled vertices and vanish whole; the others are quads still
    assert {len(polygon) for polygon in repair.mesh.polygons} == {4}
    assert len(repair.mesh.polygons) == 1498 - 75
    write_mesh(tmp_path / "pants.obj", repair.mesh)
    assert read_mesh_file(tmp_path / "pants.obj").mesh.polygons == repair.mesh.polygons


@pytest.mark.parametrize("garment", GARMENTS)
def test_garments_of_the_collection_are_sound(shared_data: Path, garment: str) -> None:
    mesh: TriMesh = read_mesh_file(shared_data / garment / "shell.obj").mesh
    warnings = validate(mesh)
    # 37 brim faces of the hat have angles from 0.63 degrees (its table) to 1; the rest is clean
    assert counts(warnings, "warning") == ({"sliver": 37} if garment.startswith("brimmed") else {})
    assert repaired(mesh).mesh is mesh
    assert len(mesh.hinges) > 0


@pytest.mark.parametrize("garment", [g for g in GARMENTS if g.endswith("avatar")])
def test_bodies_are_read(shared_data: Path, garment: str) -> None:
    mesh = read_mesh_file(shared_data / garment / "obstacle.obj").mesh
    assert (len(mesh.vertices), len(mesh.faces)) == (13380, 26756)  # the collection's table
