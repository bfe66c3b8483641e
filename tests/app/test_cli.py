"""The program against its interface: files, keys, types, exit codes, what is printed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from casashell import __version__
from casashell.app import demo, invert
from casashell.app.cli import app
from casashell.app.display import Reporter
from casashell.io import pictures
from casashell.io.meshes import read_mesh
from casashell.mesh import TriMesh
from casashell.result import Step

SILENT = "--no-pictures"


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, list(map(str, arguments)))


@pytest.fixture
def solved(page_file: Path, options: list[str]) -> Path:
    """Folder of a solved page."""
    outcome = run("invert", page_file, *options, "--out", "out", SILENT)
    assert outcome.exit_code == 0, outcome.output
    return page_file.parent / "out"


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


def test_full_folder_is_refused_before_any_work(page_file: Path, options: list[str]) -> None:
    Path("out").mkdir()
    Path("out/notes.txt").write_text("mine")
    outcome = run("invert", "missing.obj", *options, "--out", "out")
    assert outcome.exit_code == 2
    assert "--force" in outcome.stderr
    assert [item.name for item in Path("out").iterdir()] == ["notes.txt"]


def test_force_replaces_the_result_and_nothing_else(solved: Path, options: list[str]) -> None:
    (solved / "notes.txt").write_text("mine")
    for stale in ("obstacle-7.obj", "overview.png"):
        (solved / stale).write_text("old")
    outcome = run("invert", "page.obj", *options, "--out", solved, "--force", SILENT)
    assert outcome.exit_code == 0, outcome.output
    assert (solved / "notes.txt").read_text() == "mine"
    assert not (solved / "obstacle-7.obj").exists()
    assert not (solved / "overview.png").exists()


def test_an_input_is_not_overwritten(solved: Path) -> None:
    before = (solved / "scene.toml").read_bytes()
    outcome = run("invert", solved / "scene.toml", "--out", solved, "--force", SILENT)
    assert outcome.exit_code == 2
    assert "input" in outcome.stderr
    assert (solved / "scene.toml").read_bytes() == before


BAD_INPUT = {
    "missing shell": (["missing.obj"], "missing.obj"),
    "folder as shell": (["."], "folder"),
    "missing obstacle": (["page.obj", "--obstacle", "body.obj"], "body.obj"),
    "obstacle with nan": (["page.obj", "--obstacle", "nan.obj"], "vertex 1 is not finite"),
    "plane of three numbers": (["page.obj", "--plane", "0,0,1"], "NX,NY,NZ,D"),
    "plane without direction": (["page.obj", "--plane", "0,0,0,1"], "normal"),
    "pin out of range": (["page.obj", "--pin", "3,42"], "42"),
    "negative pin": (["page.obj", "--pin", "-1"], "-1"),
    "pin file with words": (["page.obj", "--pin", "pins.txt"], "line 2"),
    "missing pin file": (["page.obj", "--pin", "none.txt"], "none.txt"),
    "unknown unit": (["page.obj", "--unit", "foot"], "dm"),
    "unit zero": (["page.obj", "--unit", "0"], "unit"),
    "absurd unit": (["page.obj", "--unit", "1e12"], "its unit"),
    "unknown axis": (["page.obj", "--up", "w"], "x, y or z"),
    "gravity nan": (["page.obj", "--gravity", "nan"], "finite"),
    "gravity upwards": (["page.obj", "--gravity", "-9.81"], "-up"),
    "negative friction": (["page.obj", "--friction", "-1"], "friction"),
    "negative tolerance": (["page.obj", "--tolerance", "-1"], "tolerance"),
    "density not a number": (["page.obj", "--density", "heavy"], "density"),
    "negative bend": (["page.obj", "--bend", "-1"], "bend"),
    "method of another version": (["page.obj", "--method", "two-step"], "auto, direct"),
    "step2": (["page.obj", "--step2", "bfgs"], "auto, direct"),
    "metric": (["page.obj", "--natural", "metric"], "mesh"),
    "unknown option": (["page.obj", "--metod", "direct"], "--metod"),
    "number expected": (["page.obj", "--gravity", "down"], "--gravity"),
    "loose vertex": (["loose.obj"], "--repair"),
    "broken toml": (["broken.toml"], "broken.toml"),
    "unknown key": (["unknown.toml"], "did you mean 'density'"),
    "file in the way": (["page.obj", "--out", "page.obj"], "page.obj"),
    "file on the way": (["page.obj", "--out", "page.obj/out"], "page.obj"),
}


@pytest.mark.parametrize("name", BAD_INPUT)
def test_bad_input_is_exit_code_2_and_writes_nothing(page_file: Path, name: str) -> None:
    arguments, message = BAD_INPUT[name]
    Path("nan.obj").write_text("v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n")
    Path("loose.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 5 5 5\nf 1 2 3\n")
    Path("pins.txt").write_text("3\nfour\n")
    Path("broken.toml").write_text("[shell\n")
    Path("unknown.toml").write_text('[shell]\nfile = "page.obj"\n[material]\ndensty = 1\n')
    before = sorted(Path().rglob("*"))
    target = [] if "--out" in arguments else ["--out", "out"]
    outcome = run("invert", *arguments, *target)
    assert outcome.exit_code == 2, outcome.output
    assert message in outcome.stderr
    assert "Traceback" not in outcome.output
    assert sorted(Path().rglob("*")) == before


def test_a_shell_too_soft_is_exit_code_1_and_labelled(page_file: Path, options: list[str]) -> None:
    outcome = run("invert", page_file, *options, "--bend", "1e-9", "--out", "out", SILENT)
    assert outcome.exit_code == 1, outcome.output
    status = json.loads(Path("out/result.json").read_text())["status"]
    assert status not in ("SOLVED", "SOLVED_NEARBY")
    first = Path("out/natural.obj").read_text().splitlines()[0]
    assert status in first
    assert "not certified" in first


def test_a_shell_nothing_holds_is_exit_code_3(page_file: Path) -> None:
    outcome = run("invert", page_file, "--unit", "cm", "--out", "out", SILENT, "--quiet")
    assert outcome.exit_code == 3
    assert "INFEASIBLE" in outcome.stderr
    assert json.loads(Path("out/result.json").read_text())["status"] == "INFEASIBLE"


def test_interrupt_keeps_the_best_so_far(
    page_file: Path, options: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(step: Step) -> None:
        raise KeyboardInterrupt

    @contextmanager
    def live(self: Reporter) -> Iterator[object]:
        yield stop

    monkeypatch.setattr(Reporter, "live", live)
    outcome = run("invert", page_file, *options, "--out", "out", SILENT)
    assert outcome.exit_code == 130, outcome.output
    assert json.loads(Path("out/result.json").read_text())["status"] == "INTERRUPTED"
    assert "INTERRUPTED" in Path("out/natural.obj").read_text().splitlines()[0]


def test_interrupt_while_reading_writes_nothing(
    page_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(invert, "describe", stop)
    assert run("invert", page_file, "--out", "out").exit_code == 130
    assert not Path("out").exists()


def test_unexpected_error_is_one_line_unless_debugging(
    page_file: Path, options: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise RuntimeError("broken inside")

    monkeypatch.setattr(invert, "solve", fail)
    outcome = run("invert", page_file, *options, "--out", "out")
    assert outcome.exit_code == 1
    assert "broken inside" in outcome.stderr
    assert "--debug" in outcome.stderr
    assert "Traceback" not in outcome.output
    assert not Path("out").exists()
    debugged = run("invert", page_file, *options, "--out", "out", "--debug")
    assert isinstance(debugged.exception, RuntimeError)


def test_missing_pictures_are_a_line_not_an_error(
    page_file: Path, options: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def unavailable(*_: object, **__: object) -> None:
        raise pictures.PicturesUnavailable("install casashell[viz]")

    monkeypatch.setattr(pictures, "write_pictures", unavailable)
    outcome = run("invert", page_file, *options, "--out", "out")
    assert outcome.exit_code == 0, outcome.output
    assert outcome.stdout.count("casashell[viz]") == 1
    assert Path("out/result.json").is_file()


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


def test_a_plane_may_point_along_minus_x(page_file: Path, options: list[str]) -> None:
    outcome = run("check", page_file, *options[2:6], "--plane", "-1,0,0,-100")
    assert outcome.exit_code == 0, outcome.output


def test_check_finds_the_unit(page_file: Path) -> None:
    outcome = run("check", page_file, "--plane", "0,0,1,0", "--up", "z", "--json")
    record = json.loads(outcome.stdout)
    assert outcome.exit_code == 0
    assert record["ok"]
    assert any("--unit" in hint for hint in record["hints"])
    # half cylinder of radius 15 / pi, 20 long, read as metres
    np.testing.assert_allclose(record["size"], [20.0, 30.0 / np.pi, 15.0 / np.pi], rtol=1e-9)
    assert sorted(item.name for item in page_file.parent.iterdir()) == ["page.obj"]


def test_check_counts_contacts_and_weighs(page_file: Path, options: list[str]) -> None:
    outcome = run("check", page_file, *options, "--json")
    record = json.loads(outcome.stdout)
    assert record["hints"] == []
    assert [(each["name"], each["contacts"]) for each in record["obstacles"]] == [("plane", 12)]
    # six flat strips, each a chord 2 R sin(pi / 12) wide and 0.2 long, 10 kg/m2
    mass = 10.0 * 0.2 * 6 * 2 * (0.15 / np.pi) * np.sin(np.pi / 12)
    assert record["mass"] == pytest.approx(mass, rel=1e-9)
    assert record["weight"] == pytest.approx(9.81 * mass, rel=1e-9)


def test_check_guesses_the_up_axis(page_file: Path) -> None:
    outcome = run("check", page_file, "--plane", "0,0,1,0", "--unit", "cm", "--up", "x")
    assert "is it --up z?" in outcome.stdout


def test_check_of_a_broken_mesh_is_exit_code_2(page_file: Path) -> None:
    Path("loose.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 5 5 5\nf 1 2 3\n")
    outcome = run("check", "loose.obj", "--json")
    record = json.loads(outcome.stdout)
    assert outcome.exit_code == 2
    assert not record["ok"]
    assert [(each["kind"], each["ids"]) for each in record["findings"]] == [
        ("unreferenced_vertex", [3])
    ]
    assert any("--repair mends" in hint for hint in record["hints"])


def test_view_without_a_result_is_exit_code_2(tmp_path: Path) -> None:
    assert run("view", tmp_path / "nowhere").exit_code == 2
    assert run("view", tmp_path).exit_code == 2


def test_view_prints_where_the_report_is_and_makes_a_missing_one(solved: Path) -> None:
    report = solved / "report.html"
    report.unlink()
    outcome = run("view", solved, "--print")
    assert (outcome.exit_code, outcome.stdout.strip()) == (0, str(report))
    assert "SOLVED" in report.read_text(encoding="utf-8")
    report.write_text("as it was")
    assert run("view", solved, "--print").exit_code == 0
    assert report.read_text() == "as it was"


def test_demo_solves_its_scenes(tmp_path: Path) -> None:
    outcome = run("demo", "--out", tmp_path / "demo", SILENT)
    assert outcome.exit_code == 0, outcome.output
    for name in demo.SCENES:
        record = json.loads((tmp_path / "demo" / name / "result.json").read_text())
        assert record["status"] == "SOLVED"
    assert "friction alone" in outcome.stdout
    assert run("demo", "--out", tmp_path / "demo", SILENT).exit_code == 2


def test_help_names_every_option() -> None:
    text = CliRunner().invoke(app, ["invert", "--help"], env={"COLUMNS": "120"}).output
    for option in (
        *("--obstacle", "--plane", "--pin", "--up", "--unit", "--gravity", "--density"),
        *("--stretch", "--bend", "--friction", "--tolerance", "--method", "--out", "--force"),
        *("--no-pictures", "--quiet", "--json", "--repair"),
    ):
        assert option in text
    assert "Exit codes" in text


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
