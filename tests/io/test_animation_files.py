"""OBJ, VTK and USD series read back with other programs' readers."""

from __future__ import annotations

import builtins
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import meshio
import numpy as np
import pytest
from moving import FPS, moving

from casashell.io.animation import Animation, Track
from casashell.io.animation_files import stems, write_obj_series, write_vtk_series
from casashell.io.meshes import read_mesh
from casashell.io.usd_file import UsdUnavailable, hinge_faces, time_codes, write_usd


@pytest.fixture
def usd() -> Any:
    pytest.importorskip("pxr", reason="usd-core is not installed (extra usd)")
    from pxr import Usd

    return Usd


def test_obj_series_reads_back_to_the_last_bit(tmp_path: Path) -> None:
    animation = moving()
    told: list[tuple[int, int]] = []
    folder = write_obj_series(
        animation, tmp_path / "new", progress=lambda done, of: told.append((done, of))
    )
    assert told == [(n, 6) for n in range(1, 7)]
    cloth = animation.tracks[0]
    for frame in range(6):
        mesh = read_mesh(folder / f"a_b_{frame:04d}.obj")
        assert np.array_equal(mesh.vertices, cloth.positions[frame])
        assert np.array_equal(mesh.faces, cloth.faces)
    assert cloth.rest is not None
    assert np.array_equal(read_mesh(folder / "a_b_rest.obj").vertices, cloth.rest)
    assert len(list(folder.glob("floor*.obj"))) == 1
    times = np.loadtxt(folder / "frames.csv", delimiter=",", skiprows=1)[:, 1]
    assert np.array_equal(times, animation.times)


def test_vtk_series_reads_back_exactly(tmp_path: Path) -> None:
    animation = moving()
    listing = write_vtk_series(animation, tmp_path)
    cloth = animation.tracks[0]
    assert cloth.contact is not None
    assert cloth.lines is not None
    rows = [row.attrib for row in ElementTree.parse(listing).iter("DataSet")]
    assert len(rows) == 6 * 4  # cloth, its lines, block, floor
    for row in rows:
        frame = int(np.flatnonzero(animation.times == float(row["timestep"]))[0])
        read = meshio.read(tmp_path / row["file"])
        if row["name"] == "a_b":
            assert np.array_equal(read.points, cloth.positions[frame])
            assert np.array_equal(read.cells_dict["triangle"], cloth.faces)
            assert np.array_equal(read.point_data["contact"], cloth.contact[frame])
        elif row["name"] == "a_b_lines":
            pairs = read.points[read.cells_dict["line"]]
            assert np.array_equal(pairs, cloth.lines[frame])
        elif row["name"] == "floor":
            assert row["file"] == "floor.vtu"


def test_paraviews_reader_steps_through_the_list(tmp_path: Path) -> None:
    pv = pytest.importorskip("pyvista", reason="pyvista is not installed (extra viz)")
    animation = moving()
    reader = pv.get_reader(write_vtk_series(animation, tmp_path))
    assert np.array_equal(reader.time_values, animation.times)
    reader.set_active_time_value(reader.time_values[4])
    assert np.array_equal(reader.read()[0].points, animation.tracks[0].positions[4])


def test_other_peoples_files_stay(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("kept")
    for write in (write_obj_series, write_vtk_series):
        with pytest.raises(FileExistsError, match="not empty"):
            write(moving(), tmp_path)
    write_obj_series(moving(frames=9), tmp_path, overwrite=True)
    write_obj_series(moving(frames=3), tmp_path, overwrite=True)
    assert (tmp_path / "mine.txt").read_text() == "kept"
    assert len(list(tmp_path.glob("block_*.obj"))) == 3


def test_an_interrupted_series_leaves_nothing(tmp_path: Path) -> None:
    def stop(done: int, of: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    for write, name in ((write_obj_series, "obj"), (write_vtk_series, "vtk")):
        with pytest.raises(KeyboardInterrupt):
            write(moving(), tmp_path / name, progress=stop)
    assert list(tmp_path.iterdir()) == []


def test_track_names_become_different_file_names() -> None:
    shape = moving().tracks[2]
    names = ("A b", "a/b", "a_b", "ä", "../x", "1")
    tracks = tuple(replace(shape, name=name) for name in names)
    made = stems(Animation(moving().times, tracks))
    assert made == ("A_b", "a_b-2", "a_b-3", "track", "x", "1")


def test_usd_reads_back_exactly(tmp_path: Path, usd: Any) -> None:
    from pxr import UsdGeom

    animation = moving()
    stage = usd.Stage.Open(str(write_usd(animation, tmp_path / "a.usdc")))
    assert stage.GetTimeCodesPerSecond() == FPS
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0.0, 5.0)
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    cloth = animation.tracks[0]
    prim = stage.GetPrimAtPath("/World/a_b")
    mesh = UsdGeom.Mesh(prim)
    assert mesh.GetPointsAttr().GetTimeSamples() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    for frame in range(6):
        points = np.array(mesh.GetPointsAttr().Get(frame))
        assert np.array_equal(points, cloth.positions[frame].astype(np.float32))
    assert np.array_equal(np.array(mesh.GetFaceVertexIndicesAttr().Get()), cloth.faces.ravel())
    assert mesh.GetNormalsAttr().Get(0) is None
    assert cloth.contact is not None
    assert cloth.lines is not None
    contact = UsdGeom.PrimvarsAPI(prim).GetPrimvar("contact")
    assert np.array_equal(np.array(contact.Get(4)), cloth.contact[4])
    rulings = UsdGeom.BasisCurves(stage.GetPrimAtPath("/World/a_b_lines")).GetPointsAttr().Get(2)
    assert np.array_equal(np.array(rulings).reshape(-1, 2, 3), cloth.lines[2].astype(np.float32))
    floor = UsdGeom.Mesh(stage.GetPrimAtPath("/World/floor")).GetPointsAttr()
    assert floor.GetNumTimeSamples() == 0
    assert len(floor.Get()) == 3


def test_usd_holds_the_natural_shape(tmp_path: Path, usd: Any) -> None:
    cloth = moving().tracks[0]
    angles = np.linspace(-0.5, 0.5, 13)
    animation = replace(moving(), tracks=(replace(cloth, rest_angles=angles),))
    stage = usd.Stage.Open(str(write_usd(animation, tmp_path / "a.usda")))
    prim = stage.GetPrimAtPath("/World/a_b")
    values = {
        name: prim.GetAttribute(f"physics:{name}").Get()
        for name in ("restShapePoints", "restAdjTriPairs", "restBendAngles", "restTriVtxIndices")
    }
    assert cloth.rest is not None
    assert np.array_equal(np.array(values["restShapePoints"]), cloth.rest.astype(np.float32))
    assert np.array_equal(np.array(values["restTriVtxIndices"]), cloth.faces)
    # Single precision keeps degrees below 30 to 1e-6.
    assert np.allclose(np.array(values["restBendAngles"]), np.degrees(angles), atol=2e-6)
    # The two faces of a pair share the edge of the hinge.
    pairs = np.array(values["restAdjTriPairs"])
    assert np.array_equal(pairs, hinge_faces(cloth))
    for (first, second), hinge in zip(pairs, cloth.mesh.hinges):
        shared = set(cloth.faces[first]) & set(cloth.faces[second])
        assert shared == set(hinge[:2])
        assert hinge[2] in cloth.faces[first]


@pytest.mark.parametrize(("up", "token"), [("x", "Y"), ("y", "Y"), ("z", "Z")])
def test_usd_stands_upright(tmp_path: Path, usd: Any, up: str, token: str) -> None:
    from pxr import Gf, UsdGeom

    animation = moving(up=up)
    stage = usd.Stage.Open(str(write_usd(animation, tmp_path / "a.usda")))
    assert UsdGeom.GetStageUpAxis(stage) == token
    prim = stage.GetPrimAtPath("/World/a_b")
    world = UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(0.0)
    upward = np.array(world.TransformDir(Gf.Vec3d(*animation.up)))
    assert np.allclose(upward, [0, 1, 0] if token == "Y" else [0, 0, 1], atol=1e-12)


def test_uneven_times_keep_their_place() -> None:
    times = np.array([0.0, 0.1, 0.2, 0.25, 0.3, 0.4])
    assert np.allclose(time_codes(replace(moving(), times=times)), times * 10.0, rtol=1e-12)


def test_usd_refuses_before_any_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ValueError, match=r"\.usdc"):
        write_usd(moving(), tmp_path / "a.obj")
    real = builtins.__import__

    def without(name: str, *args: Any, **kwargs: Any) -> Any:
        if name.split(".")[0] == "pxr":
            raise ImportError("No module named 'pxr'")
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(UsdUnavailable, match="extra 'usd'"):
        write_usd(moving(), tmp_path / "a.usdc")
    assert list(tmp_path.iterdir()) == []


def test_usd_does_not_overwrite(tmp_path: Path, usd: Any) -> None:
    file = tmp_path / "a.usdc"
    file.write_text("mine")
    with pytest.raises(FileExistsError, match="exists"):
        write_usd(moving(), file)
    assert file.read_text() == "mine"
    write_usd(moving(), file, overwrite=True)
    assert usd.Stage.Open(str(file)).GetPrimAtPath("/World/block")
    assert [path.name for path in tmp_path.iterdir()] == ["a.usdc"]


def test_names_that_are_one_identifier_are_told_apart(tmp_path: Path, usd: Any) -> None:
    shape = moving().tracks[2]
    tracks: tuple[Track, ...] = (replace(shape, name="a-b"), replace(shape, name="a_b"))
    stage = usd.Stage.Open(str(write_usd(Animation(moving().times, tracks), tmp_path / "a.usda")))
    assert len(stage.GetPrimAtPath("/World").GetChildren()) == 2
