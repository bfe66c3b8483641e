"""`casashell check`, `view`, `demo` and the help."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from running import SILENT, run
from typer.testing import CliRunner

from casashell.app import demo
from casashell.app.cli import app


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


def test_check_reads_scene_files(solved: Path) -> None:
    outcome = run("check", solved / "scene.toml", "--json")
    record = json.loads(outcome.stdout)
    assert (outcome.exit_code, record["contacts"], record["unit"]) == (0, 12, 0.01)
    assert "page: 42 vertices" in run("check", solved / "scene.toml").stdout  # keeps its name


def block(path: Path, corner: float, size: float, height: float) -> Path:
    """A closed box as OBJ, size wide and high, its lower corner at (corner, corner, height)."""
    points = [
        f"v {corner + size * x} {corner + size * y} {height + size * z}"
        for x in (0, 1)
        for y in (0, 1)
        for z in (0, 1)
    ]
    quads = ["1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4"]
    path.write_text("\n".join([*points, *(f"f {quad}" for quad in quads)]) + "\n")
    return path


def test_hints_about_placement(page_file: Path) -> None:
    """The page spans 20 x 9.5 x 4.8 cm around the z axis and stands on z = 0."""
    scene = ("check", page_file, "--unit", "cm", "--up", "z", "--obstacle")
    far = run(*scene, block(Path("far.obj"), 100.0, 50.0, -50.0))
    assert "'far' are 1.31 m apart" in far.stdout  # 90 cm one way, 95.2 cm the other
    above = run(*scene, block(Path("above.obj"), -25.0, 50.0, 4.8))
    assert "the whole shell is below 'above'" in above.stdout
    under = run(*scene, block(Path("under.obj"), -25.0, 50.0, -50.0))
    assert "hint" not in under.stdout
    assert under.exit_code == 0
    itself = run(*scene[:-1], "--obstacle", page_file)
    assert "'page' has the very extent of the shell" in itself.stdout


def test_hints_about_contact(page_file: Path, options: list[str]) -> None:
    wide = run("check", page_file, *options, "--tolerance", "100")
    assert "hint: the contact tolerance is 441 % of the shell's size" in wide.stdout
    deep = run("check", page_file, *options, "--plane", "0,0,1,30")
    assert "42 of 42 vertices are deep inside an obstacle" in deep.stdout


def test_invert_gives_the_hints_too(page_file: Path, options: list[str]) -> None:
    outcome = run("invert", page_file, *options, "--tolerance", "100", "--out", "out", SILENT)
    assert "hint: the contact tolerance" in outcome.stdout


def test_hints_survive_hardly_any_gravity(page_file: Path, options: list[str]) -> None:
    outcome = run("check", page_file, *options, "--gravity", "1e-300")
    assert outcome.exit_code == 0, outcome.output
    assert "nan" not in outcome.stdout


def test_nothing_free_to_move_is_no_missing_number(page_file: Path, options: list[str]) -> None:
    every = ",".join(map(str, range(42)))
    outcome = run("invert", page_file, *options, "--pin", every, "--out", "out", SILENT)
    assert outcome.exit_code == 0, outcome.output
    assert "no vertex is free to move" in outcome.stdout
    assert "no vertex is free" in Path("out/report.html").read_text(encoding="utf-8")
