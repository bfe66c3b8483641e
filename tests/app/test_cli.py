"""`casashell invert` against its interface: files, keys, types, what is printed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from running import SILENT, run

from casashell import __version__
from casashell.io.meshes import read_mesh
from casashell.mesh import TriMesh


def test_files_of_a_solved_scene(solved: Path) -> None:
    expected = {"natural.obj", "pose.obj", "target.obj", "result.json", "result.npz", "scene.toml"}
    assert {item.name for item in solved.iterdir()} == expected | {"report.html"}
    assert not list(solved.parent.glob(".casashell-*"))


def test_npz_keys_types_and_shapes(solved: Path, quads: TriMesh) -> None:
    with np.load(solved / "result.npz", allow_pickle=False) as file:
        arrays = dict(file)
    vertices, faces = len(quads.vertices), len(quads.faces)
    edges, hinges, contacts = len(quads.edges), len(quads.hinges), 12  # two edges of 6 vertices
    floats = {
        **dict.fromkeys(("rest", "pose", "target", "forces"), (vertices, 3)),
        **dict.fromkeys(("stretch", "bend", "density"), ()),
        **dict.fromkeys(("normals", "contact_forces"), (contacts, 3)),
        **dict.fromkeys(("friction", "gaps"), (contacts,)),
        "gravity": (3,),
    }
    integers = {
        **{"faces": (faces, 3), "edges": (edges, 2), "hinges": (hinges, 4), "pinned": (0,)},
        **dict.fromkeys(("contacts", "obstacle"), (contacts,)),
    }
    assert set(arrays) == set(floats) | set(integers)
    for key, shape in floats.items():
        assert (arrays[key].dtype, arrays[key].shape) == (np.float64, shape), key
    for key, shape in integers.items():
        assert (arrays[key].dtype, arrays[key].shape) == (np.int64, shape), key
    np.testing.assert_allclose(arrays["target"], quads.vertices, atol=1e-15)
    np.testing.assert_array_equal(arrays["gravity"], [0.0, 0.0, -9.81])
    np.testing.assert_array_equal(arrays["normals"], [[0.0, 0.0, 1.0]] * contacts)
    # on the shell: together they carry the weight of the natural shape, 10 kg/m2 * 9.81 m/s2 * area
    area = quads.moved(arrays["rest"]).face_areas.sum()
    total = arrays["contact_forces"].sum(axis=0)
    np.testing.assert_allclose(total, [0.0, 0.0, 98.1 * area], atol=1e-8)


def test_json_keys(solved: Path) -> None:
    record = json.loads((solved / "result.json").read_text())
    assert {
        *("status", "advice", "method", "seconds", "vertices", "contacts"),
        *("iterations", "factorizations", "certificate", "quality"),
    } <= set(record)
    assert {
        *("free_force", "cone_margin", "min_normal_force", "min_eigenvalue"),
        *("min_eigenvalue_scaled", "target_distance"),
    } <= set(record["certificate"])
    assert set(record["quality"]) == {
        *("max_stretch", "max_rest_fold", "min_rest_angle", "flipped_faces"),
        *("rest_self_intersections", "softest_factor"),
    }
    assert (record["status"], record["vertices"], record["contacts"]) == ("SOLVED", 42, 12)
    assert record["certificate"]["free_force"] <= 1e-6


def test_meshes_have_the_unit_and_the_polygons_of_the_input(
    solved: Path, page_file: Path, quads: TriMesh
) -> None:
    def faces(path: Path) -> list[str]:
        return [line for line in path.read_text().splitlines() if line.startswith("f ")]

    assert faces(page_file)[0].count(" ") == 4
    for name in ("natural.obj", "pose.obj"):
        assert faces(solved / name) == faces(page_file)
    pose = read_mesh(solved / "pose.obj")
    np.testing.assert_allclose(pose.vertices, 100.0 * quads.vertices, atol=1e-12)
    natural = read_mesh(solved / "natural.obj", unit=0.01)
    with np.load(solved / "result.npz") as file:
        np.testing.assert_allclose(natural.vertices, file["rest"], atol=1e-15)
    assert "SOLVED" in (solved / "natural.obj").read_text().splitlines()[0]


def test_summary_for_people(page_file: Path, options: list[str]) -> None:
    outcome = run("invert", page_file, *options, "--out", "out", SILENT)
    for text in ("42 vertices", "unit cm", "12 vertices within", "plane", "SOLVED", "natural.obj"):
        assert text in outcome.stdout
    assert outcome.stderr == ""


def test_default_folder_is_named_after_the_shell(page_file: Path, options: list[str]) -> None:
    assert run("invert", page_file, *options, SILENT).exit_code == 0
    assert (page_file.parent / "page-natural" / "natural.obj").is_file()


def test_json_option_prints_the_record_alone(page_file: Path, options: list[str]) -> None:
    outcome = run("invert", page_file, *options, "--out", "out", SILENT, "--json")
    assert json.loads(outcome.stdout) == json.loads(Path("out/result.json").read_text())


def test_quiet_prints_nothing(page_file: Path, options: list[str]) -> None:
    outcome = run("invert", page_file, *options, "--out", "out", SILENT, "--quiet")
    assert (outcome.exit_code, outcome.output) == (0, "")


def test_repair_writes_where_vertices_went(page_file: Path, options: list[str]) -> None:
    lines = page_file.read_text().splitlines()
    first = next(number for number, line in enumerate(lines) if line.startswith("v "))
    lines.insert(first, "v 9 9 9")  # a vertex in no face before all others
    shifted = [
        "f " + " ".join(str(int(word) + 1) for word in line.split()[1:])
        if line.startswith("f ")
        else line
        for line in lines
    ]
    Path("loose.obj").write_text("\n".join(shifted) + "\n")
    outcome = run("invert", "loose.obj", *options, "--repair", "--out", "out", SILENT)
    assert outcome.exit_code == 0, outcome.output
    assert "dropped 1 vertex" in outcome.stdout
    rows = Path("out/vertex_map.txt").read_text().splitlines()[1:]
    assert rows[:3] == ["0 -1", "1 0", "2 1"]
    assert len(read_mesh("out/natural.obj").vertices) == 42


def test_options_override_a_scene_file(solved: Path) -> None:
    outcome = run(
        *("invert", solved / "scene.toml", "--density", "8", "--friction", "0.7"),
        *("--pin", "20", "--out", "again", SILENT),
    )
    assert outcome.exit_code == 0, outcome.output
    with np.load("again/result.npz") as file:
        assert file["density"] == 8.0
        assert set(file["friction"]) == {0.7}
        assert file["pinned"].tolist() == [20]
        assert file["bend"] == 2e-3


def program(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    root = str(Path(__file__).resolve().parents[2])
    return subprocess.run(
        [sys.executable, "-m", "casashell", *arguments],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": root},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def test_as_a_process(page_file: Path, options: list[str]) -> None:
    cwd = page_file.parent
    assert program("--version", cwd=cwd).stdout.strip() == f"casashell {__version__}"
    solved = program("invert", "page.obj", *options, SILENT, "--json", cwd=cwd)
    assert (solved.returncode, solved.stderr) == (0, "")
    assert json.loads(solved.stdout)["status"] == "SOLVED"
    missing = program("invert", "nothing.obj", cwd=cwd)
    assert missing.returncode == 2
    assert missing.stderr == "casashell: nothing.obj: no such file\n"
