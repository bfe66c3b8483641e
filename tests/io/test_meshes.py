"""Mesh files: what is read, kept, written back and refused."""

from __future__ import annotations

import struct
from pathlib import Path

import meshio
import numpy as np
import pytest

from casashell.io.meshes import read_mesh, read_mesh_file, write_mesh
from casashell.io.polygons import triangulated
from casashell.mesh import TriMesh

# coordinates that need all 17 digits of a double
VERTICES = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0.1], [0, 1, 0], [2, 0, 1 / 3], [2, 1, np.pi]])
FACES = np.array([[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2]])
QUADS = ((0, 1, 2, 3), (1, 4, 5, 2))


def written(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text)
    return path


TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".vtk", ".vtu", ".off", ".mesh", ".stl"])
def test_round_trip_keeps_every_bit_of_the_coordinates(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"mesh{suffix}"
    mesh = TriMesh(VERTICES, FACES)
    write_mesh(path, mesh)
    back = read_mesh(path)
    # STL has no vertex list, so its vertices come in the order in which the faces use them
    order = [0, 1, 2, 3, 4, 5]
    np.testing.assert_array_equal(back.vertices, VERTICES[order])
    np.testing.assert_array_equal(back.faces, FACES)
    assert back.polygons == ()


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".vtk", ".vtu"])
def test_polygons_are_written_back_in_their_order(tmp_path: Path, suffix: str) -> None:
    polygons = ((1, 4, 5, 2), (0, 1, 2), (0, 2, 3))
    mesh = TriMesh(VERTICES, triangulated(VERTICES, polygons), polygons)
    path = tmp_path / f"mesh{suffix}"
    write_mesh(path, mesh)
    back = read_mesh_file(path)
    assert back.mesh.polygons == polygons
    np.testing.assert_array_equal(back.mesh.faces, mesh.faces)
    assert back.notes == ("1 quad was split along the shorter diagonal",)


@pytest.mark.parametrize("suffix", [".stl", ".off"])
def test_formats_without_quads_get_the_triangles(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"mesh{suffix}"
    write_mesh(path, TriMesh(VERTICES, triangulated(VERTICES, QUADS), QUADS))
    assert len(read_mesh(path).faces) == 4


def test_real_quads_round_trip_through_obj(shared_data: Path, tmp_path: Path) -> None:
    source = shared_data / "shirt_avatar" / "original" / "shirt02.obj"
    first = read_mesh_file(source)
    # 1314 quads: counted in the file with awk
    assert first.notes == ("1314 quads were split along the shorter diagonal",)
    write_mesh(tmp_path / "copy.obj", first.mesh)
    lines = [line.split() for line in source.read_text().splitlines()]
    corners = [[w.split("/")[0] for w in words[1:]] for words in lines if words[0] == "f"]
    points = [list(map(float, words[1:])) for words in lines if words[0] == "v"]
    copy = [line.split() for line in (tmp_path / "copy.obj").read_text().splitlines()]
    assert [words[1:] for words in copy if words[0] == "f"] == corners
    assert [list(map(float, words[1:])) for words in copy if words[0] == "v"] == points


def test_unit_scales_both_ways(tmp_path: Path) -> None:
    path = written(tmp_path, "a.obj", TRIANGLE + "f 1 2 3\n")
    mesh = read_mesh(path, unit=0.01)
    np.testing.assert_allclose(mesh.vertices[1], [0.01, 0, 0])
    write_mesh(tmp_path / "b.obj", mesh, unit=0.01)
    np.testing.assert_allclose(read_mesh(tmp_path / "b.obj").vertices[1], [1, 0, 0])
    for unit in (0.0, -1.0, float("nan")):
        with pytest.raises(ValueError, match="unit must be a positive number"):
            read_mesh(path, unit=unit)


def test_other_positions_may_be_written(tmp_path: Path) -> None:
    mesh = TriMesh(VERTICES, FACES)
    write_mesh(tmp_path / "a.obj", mesh, vertices=2 * VERTICES)
    np.testing.assert_array_equal(read_mesh(tmp_path / "a.obj").vertices, 2 * VERTICES)
    with pytest.raises(ValueError, match=r"b\.obj: cannot write: .*5 positions"):
        write_mesh(tmp_path / "b.obj", mesh, vertices=VERTICES[:5])


@pytest.mark.parametrize(
    "faces",
    [
        "f 1/1 2/2 3/3",
        "f 1//1 2//1 3//1",
        "f 1/1/1 2/2/1 3/3/1 # last",
        "f -3 -2 -1",
        "f -3/1/-1 -2/1/-1 -1/1/-1",
        "f 1 2 \\\n  3",
        "usemtl red\ng sleeve\ns off\nf 1 2 3\ng\ng cuff",
        "f  1\t2   3  ",
    ],
)
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_obj_dialects(tmp_path: Path, faces: str, newline: str) -> None:
    text = f"\ufeff# a comment\nmtllib x.mtl\no first\n{TRIANGLE}vt 0 0\nvn 0 0 1\n{faces}\n"
    path = tmp_path / "a.OBJ"
    path.write_bytes(text.replace("\n", newline).encode())
    mesh = read_mesh(path)
    assert mesh.faces.tolist() == [[0, 1, 2]]
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]


def test_obj_with_objects_colours_weights_and_latin_letters(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_bytes(
        b"# \xe9toffe\no one\nv 0 0 0 1 0 0\nv 1 0 0 1.0\nv 0 1 0\nf -3 -2 -1\n"
        b"o two\nv 0 0 1\nv 1 0 1\nv 0 1 1\nf -3 -2 -1\nf 1 2 6 3\nl 1 2\nl 2 3\n"
    )
    held = read_mesh_file(path)
    assert held.mesh.polygons == ((0, 1, 2), (3, 4, 5), (0, 1, 5, 2))
    assert len(held.mesh.faces) == 4
    assert held.notes[1] == "2 line elements were ignored: only faces count"


def test_off_with_quads_comments_and_colours(tmp_path: Path) -> None:
    text = (
        "OFF # made by hand\n\n5  2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n2 0 0\n"
        "4 0 1 2 3 255 0 0\n3 1 4 2\n"
    )
    mesh = read_mesh(written(tmp_path, "a.off", text))
    assert mesh.polygons == ((0, 1, 2, 3), (1, 4, 2))
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3], [1, 4, 2]]


def test_stl_corners_are_joined_and_said_so(tmp_path: Path) -> None:
    corners = VERTICES[FACES].astype("<f4")
    records = b"".join(
        np.zeros(3, "<f4").tobytes() + triangle.tobytes() + b"\0\0" for triangle in corners
    )
    (tmp_path / "a.stl").write_bytes(b"x" * 80 + struct.pack("<I", 4) + records)
    held = read_mesh_file(tmp_path / "a.stl")
    assert held.mesh.faces.tolist() == FACES.tolist()
    assert len(held.mesh.hinges) == 3
    assert held.notes == (
        "STL stores no connectivity: 12 corners were joined to 6 vertices where they coincide"
        " exactly",
    )


def test_planar_points_get_a_third_coordinate(tmp_path: Path) -> None:
    text = "NDIME= 2\nNELEM= 1\n5 0 1 2 0\nNPOIN= 3\n0 0 0\n1 0 1\n0 1 2\nNMARK= 0\n"
    mesh = read_mesh(written(tmp_path, "a.su2", text))
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]


def test_line_cells_are_named(tmp_path: Path) -> None:
    cells = [("triangle", [[0, 1, 2]]), ("line", [[0, 1], [1, 2]])]
    meshio.write(tmp_path / "a.vtu", meshio.Mesh(np.eye(3), cells))
    held = read_mesh_file(tmp_path / "a.vtu")
    assert held.mesh.faces.tolist() == [[0, 1, 2]]
    assert held.notes == ("2 line cells were ignored: only faces count",)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.obj", "", "no faces, only 0 vertices"),
        ("a.obj", TRIANGLE, "no faces, only 3 vertices; a mesh of triangles"),
        ("a.obj", TRIANGLE + "l 1 2 3\n", "no faces, only 3 vertices, 1 line element"),
        ("a.obj", TRIANGLE + "f 1 2 4\n", "line 4: face with vertex 4, but the file has only 3"),
        ("a.obj", TRIANGLE + "f 0 1 2\n", "line 4: face with vertex 0, but OBJ counts .* from 1"),
        ("a.obj", TRIANGLE + "f -4 1 2\n", "line 4: face with vertex -4"),
        ("a.obj", TRIANGLE + "f 1 2\n", "line 4: a face needs three vertices"),
        ("a.obj", TRIANGLE + "f 1 2 x\n", "line 4: invalid literal"),
        ("a.obj", "v 0 0\n", "line 1: a vertex needs three coordinates, found 2"),
        ("a.obj", "v 0,5 0 0\n", "line 1: could not convert"),
        ("a.obj", "v 0 0 nan\n" + TRIANGLE + "f 1 2 3 4\n", "vertex 0 is not finite"),
        ("a.obj", "v inf 0 0\n" + TRIANGLE + "v 2 2 2\nf 1 2 3 4 5\n", "vertex 0 is not finite"),
        ("a.obj", "\0\1\2 binary", "no faces"),
        ("a.off", "COFF\n", "line 1: an OFF file starts with the word OFF"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n", "the file ends after line 4"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", r"line 6: face with .*\(0, 1, 3\)"),
        ("a.ply", "not a ply file", "damaged, or not what its extension says"),
        ("a.ply", "", "damaged"),
        ("a.ply", "ply\nformat ascii 1.0\nelement vertex 3\n", "the PLY header has no end"),
        ("a.stl", "solid a\nfacet normal 0 0 1\nouter", "damaged"),
        ("a.stl", "v 0 0 0\n" * 30, "damaged"),
        ("a.vtk", "# vtk DataFile Version 3.0\n", "damaged"),
        ("a.vtu", "<xml", "damaged"),
        ("a.xyz", "0 0 0\n", "unknown extension '.xyz'; use .obj"),
        ("a", "0 0 0\n", "unknown extension ''"),
        ("a.node", "0 0 0\n", "unknown extension '.node'"),
    ],
)
def test_bad_files_are_one_clear_error(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], name: str, text: str, message: str
) -> None:
    path = written(tmp_path, name, text)
    with pytest.raises(ValueError, match=message) as caught:
        read_mesh(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_missing_file_and_folder_are_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"none\.obj: no such file"):
        read_mesh(tmp_path / "none.obj")
    (tmp_path / "folder.obj").mkdir()
    with pytest.raises(ValueError, match=r"folder\.obj: is a folder"):
        read_mesh(tmp_path / "folder.obj")


@pytest.mark.parametrize("kind", ["points", "tetra", "index"])
def test_files_without_usable_faces(tmp_path: Path, kind: str) -> None:
    points = np.vstack([np.zeros(3), np.eye(3)])
    cells, message = {
        "points": ([("vertex", [[0], [1]])], "no faces, only 4 vertices, 2 vertex cells"),
        "tetra": ([("tetra", [[0, 1, 2, 3]])], "no faces, only 4 vertices, 1 tetra cell;"),
        "index": ([("triangle", [[0, 1, 9]])], r"face 0 has vertices \(0, 1, 9\), outside 0\.\.3"),
    }[kind]
    meshio.write(tmp_path / "a.vtk", meshio.Mesh(points, cells))
    with pytest.raises(ValueError, match=rf"a\.vtk: {message}"):
        read_mesh(tmp_path / "a.vtk")


def test_writing_where_it_is_impossible_names_the_file(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    mesh = TriMesh(VERTICES, FACES)
    for name in ("no/such/folder.obj", "no/such/folder.ply"):
        with pytest.raises(ValueError, match=rf"{name}: cannot write: No such file or directory"):
            write_mesh(tmp_path / name, mesh)
    with pytest.raises(ValueError, match=r"a\.docx: cannot write: unknown extension '\.docx'"):
        write_mesh(tmp_path / "a.docx", mesh)
    write_mesh(tmp_path / "a.ply", mesh)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("corners", "expected"),
    [
        ([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]]),  # equal: cut 0-2
        ([[0, 0], [3, 0], [4, 1], [1, 1]], [[0, 1, 3], [1, 2, 3]]),  # 1-3 is shorter
        ([[0, 0], [1, 0], [4, 1], [3, 1]], [[0, 1, 3], [1, 2, 3]]),  # 1-3 shorter: sqrt 5, sqrt 17
        # an arrow head, notch at 2: the cut 1-3 is shorter but runs outside
        ([[0, 0], [4, -1], [3, 0], [4, 1]], [[0, 1, 2], [0, 2, 3]]),
        # the same from the next corner: now 0-2 is outside
        ([[4, -1], [3, 0], [4, 1], [0, 0]], [[0, 1, 3], [1, 2, 3]]),
    ],
)
def test_quads_are_cut_inside_along_the_shorter_diagonal(
    corners: list[list[float]], expected: list[list[int]]
) -> None:
    vertices = np.column_stack([np.array(corners, dtype=float), np.zeros(4)])
    assert triangulated(vertices, [(0, 1, 2, 3)]).tolist() == expected


@pytest.mark.parametrize("lift", [0.0, 0.05])
def test_concave_polygons_are_covered_exactly(lift: float) -> None:
    # a star with five spikes: area by the shoelace formula, every triangle counter-clockwise
    angle = np.arange(10) * np.pi / 5
    radius = np.where(np.arange(10) % 2 == 0, 1.0, 0.4)
    xy = radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    vertices = np.column_stack([xy, lift * (-1.0) ** np.arange(10)])
    faces = triangulated(vertices, [tuple(range(10))])
    after = np.roll(xy, -1, axis=0)
    area = 0.5 * (xy[:, 0] * after[:, 1] - xy[:, 1] * after[:, 0]).sum()
    u, v = xy[faces[:, 1]] - xy[faces[:, 0]], xy[faces[:, 2]] - xy[faces[:, 0]]
    signed = 0.5 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    assert (signed > 0).all()
    assert signed.sum() == pytest.approx(area)


def test_a_polygon_that_crosses_itself_still_gives_its_triangles() -> None:
    vertices = np.array([[0, 0, 0], [2, 2, 0], [2, 0, 0], [0, 2, 0], [-1, 1, 0.0]])
    faces = triangulated(vertices, [(0, 1, 2, 3, 4)])
    assert len(faces) == 3
    assert set(faces.ravel().tolist()) == {0, 1, 2, 3, 4}


@pytest.mark.parametrize(
    "text",
    [
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 4 3\n",
        "o a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\n",
        "v  0  0  0\nv 1 0 0 # corner\nv 0 1 0\n f 1 2 3\nf -3 -2 -1\n",
        "v 0 0\nv 1 0 0 5\nv 0 1 0\nf 1 2 3\n",
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2\nf 1 2 3 3\n",
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n",
        "v 0 0 0\nv 1 0 x\nv 0 1 0\nf 1 2 3\n",
    ],
)
def test_the_fast_obj_reader_says_what_the_careful_one_says(
    tmp_path: Path, text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from casashell.io import mesh_text

    def read() -> object:
        try:
            soup = mesh_text.read_obj(path)
        except ValueError as problem:
            return str(problem)
        return np.asarray(soup.points).tolist(), soup.polygons, soup.ignored

    path = tmp_path / "mesh.obj"
    path.write_text(text)
    fast = read()
    monkeypatch.setattr(mesh_text, "_plain_obj", lambda path: None)
    assert fast == read()
