"""Files of motions: keyframes, sequences of meshes, and what carries a shell along."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from running import SILENT, run
from simulating import UNIT, steady, table, write_sequence

from casashell.app.keyframe_files import read_keyframes
from casashell.app.motion_files import read_motions, sequence_files
from casashell.contact.mesh_obstacle import MeshObstacle
from casashell.dynamics.motion import MeshSequence
from casashell.dynamics.simulation import Simulation
from casashell.io.meshes import read_mesh, write_mesh
from casashell.mesh import TriMesh


def moved(out: Path, *arguments: str | Path) -> np.ndarray:
    """How far each vertex came, (V,3) m."""
    outcome = run("simulate", *arguments, "--out", out, SILENT)
    assert outcome.exit_code == 0, outcome.output
    positions = Simulation.load(out).positions
    return np.asarray(positions[-1] - positions[0])


def test_keyframes_and_a_sequence_of_the_same_motion_agree(
    page_on_mesh: Path, tmp_path: Path
) -> None:
    """A table that starts at 0.06 m/s under the page: what stands on it goes along, 6 mm."""
    write_sequence(tmp_path / "tables", steady(7, 0.001))
    keys = tmp_path / "keys.csv"
    keys.write_text("# centimetres\ntime,x,y,z\n0,0,0,0\n0.1,0.6,0,0\n")
    common = (page_on_mesh, "--seconds", "0.1")
    sequence = moved(tmp_path / "a", *common, "--obstacle-sequence", f"table={tmp_path / 'tables'}")
    rigid = moved(tmp_path / "b", *common, "--keyframes", f"0={keys}")
    feet = Simulation.load(tmp_path / "a").contact[0]
    assert feet.sum() == 12
    assert sequence[feet, 0].mean() == pytest.approx(0.006, rel=0.1)
    np.testing.assert_allclose(sequence, rigid, atol=1e-9)
    text = (tmp_path / "a" / "player.html").read_text()
    assert "table" in text
    assert "ball" in text


def test_bodies_are_shown_as_they_moved(page_on_mesh: Path, tmp_path: Path) -> None:
    """The series of the table is the sequence that it was given, in the unit of the files."""
    write_sequence(tmp_path / "in", steady(4, 0.001))
    pattern = f"table={tmp_path / 'in' / 'table_%03d.obj'}"
    line = (page_on_mesh, "--seconds", "0.1", "--fps", "20", "--sequence-fps", "30")
    moved(tmp_path / "out", *line, "--obstacle-sequence", pattern, "--formats", "obj")
    import meshio

    shown = meshio.read(tmp_path / "out" / "obj" / "table_0002.obj").points
    np.testing.assert_allclose(UNIT * shown, table().vertices + steady(4, 0.001)[3], atol=1e-12)


def test_sequence_files_come_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    for number in (9, 10, 11):
        (tmp_path / f"body2_{number}.obj").touch()
    (tmp_path / "body2_rest.txt").touch()
    names = ["body2_9.obj", "body2_10.obj", "body2_11.obj"]
    for form in ("", "body2_*.obj", "body2_%d.obj", "body2_%04d.obj"):
        assert [path.name for path in sequence_files(str(tmp_path / form))] == names


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ((), "no numbered meshes"),
        (("a_1.obj", "a_3.obj"), "number 2 is missing"),
        (("a_1.obj", "b_1.obj"), "several series"),
        (("a_1.obj", "a_01.obj"), "number of its own"),
    ],
)
def test_folders_that_are_no_sequence(tmp_path: Path, names: tuple[str, ...], words: str) -> None:
    for name in names:
        (tmp_path / name).touch()
    with pytest.raises(ValueError, match=words):
        sequence_files(str(tmp_path))


def test_quads_are_compared_as_quads(tmp_path: Path) -> None:
    """A sheared box is cut along other diagonals when it is read, and is the same box."""
    corners = table()
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    box = TriMesh(corners.vertices, corners.faces, tuple(quads))
    shear = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.5, 0.0, 1.0]])
    poses = [box.vertices, box.vertices @ shear]
    for number, points in enumerate(poses):
        write_mesh(tmp_path / f"box_{number}.obj", box, points, unit=UNIT)
    assert not np.array_equal(read_mesh(tmp_path / "box_1.obj").faces, box.faces)
    obstacle = MeshObstacle(box, 0.5, "box")
    motions = read_motions((f"box={tmp_path}",), (), (obstacle,), unit=UNIT, fps=10.0)
    motion = motions[0]
    assert isinstance(motion, MeshSequence)
    assert motion.times.tolist() == [0.0, 0.1]
    np.testing.assert_allclose(motion.vertices, poses, atol=1e-15)


def test_keyframes_in_toml_turn_about_a_center(tmp_path: Path) -> None:
    """90 degrees about z through (1, 0, 0) take the origin to (1, -1, 0); then a shift."""
    path = tmp_path / "keys.toml"
    path.write_text(
        "center = [1.0, 0.0, 0.0]\n[[keyframe]]\ntime = 0\n"
        "[[keyframe]]\ntime = 2.0\naxis = [0, 0, 3]\nangle = 90\ntranslation = [0, 0, 5]\n"
    )
    turn, shift = read_keyframes(path, UNIT).at(2.0)
    np.testing.assert_allclose(shift, [0.01, -0.01, 0.05], atol=1e-15)
    np.testing.assert_allclose(turn @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-15)


def test_quaternions_go_the_shorter_way_angles_as_written(tmp_path: Path) -> None:
    """Four quaternions 100 degrees apart make 300 degrees; an angle of 300 is one turn of 300."""
    half = np.radians([0.0, 50.0, 100.0, 150.0, 180.0])
    lines = [f"{k},{math.cos(h)!r},0,{math.sin(h)!r},0" for k, h in enumerate(half.tolist())]
    one = tmp_path / "one.csv"
    one.write_text("\n".join(["time,qw,qx,qy,qz", *lines]))
    turned = np.degrees(np.asarray(read_keyframes(one, 1.0).rotation))
    np.testing.assert_allclose(turned[:, 1], [0, 100, 200, 300, 360], atol=1e-9)
    other = tmp_path / "other.csv"
    other.write_text("time,axis_x,axis_y,axis_z,angle\n0,0,1,0,0\n1,0,2,0,300\n2,0,1,0,20\n")
    turned = np.degrees(np.asarray(read_keyframes(other, 1.0).rotation))
    np.testing.assert_allclose(turned[:, 1], [0, 300, 20], atol=1e-9)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("k.csv", "time,x,y,z\n0,0,0,0\n1,nan,0,0\n", "keyframe 1: x must be a finite number"),
        ("k.csv", "time,x,y,z\n0,0,0\n", "3 values for 4 columns"),
        ("k.csv", "time,x,y\n0,0,0\n", "needs the columns x, y, z"),
        ("k.csv", "time,angel\n0,0\n", "did you mean 'angle'"),
        ("k.csv", "time,angle\n0,5\n", "axis and angle belong together"),
        ("k.csv", "time,x,y,z\n", "no keyframes"),
        ("k.csv", "time\n0\n0\n", "keyframe 1 is at 0 s, not after"),
        ("k.csv", "x,y,z\n0,0,0\n", "time is missing"),
        ("k.csv", "time,qw,qx,qy,qz\n0,0,0,0,0\n", "quaternion is zero"),
        ("k.csv", "time,axis_x,axis_y,axis_z,angle\n0,0,0,0,9\n", "axis has no direction"),
        ("k.toml", "[[keyframe]]\ntime = nan\n", "keyframe 0: time must be a finite number"),
        ("k.toml", "[[keyframe]]\ntime = 0\nquaternion = [1, 0, 0]\n", "four finite numbers"),
        ("k.toml", "[[keyframe]]\ntime = 0\nquaternion = [1, 0, 0, nan]\n", "finite number"),
        ("k.toml", "[keyframe]\ntime = 0\n", r"\[\[keyframe\]\]"),
        ("k.toml", "centre = [0, 0, 0]\n", "did you mean 'center'"),
        ("k.json", "{}", "read from .toml or .csv"),
    ],
)
def test_keyframes_with_faults(tmp_path: Path, name: str, text: str, words: str) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(ValueError, match=words) as fault:
        read_keyframes(path, 1.0)
    assert str(path) in str(fault.value)
