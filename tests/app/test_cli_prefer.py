"""`--prefer` and the key of the scene file; `--start`."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from running import SILENT, run


def test_the_preferred_file_steers_the_answer(solved: Path, options: list[str]) -> None:
    """An earlier answer, turned in space, is found again; wide of it means it was not read."""
    lines = [line.split() for line in (solved / "natural.obj").read_text().splitlines()]
    turned = [
        f"v {y} {z} {x}" if line[0] == "v" else " ".join(line)
        for line in lines
        for x, y, z in [line[1:4] if line[0] == "v" else ("", "", "")]
    ]
    Path("flat.obj").write_text("\n".join(turned) + "\n")
    outcome = run(
        *("invert", "page.obj", *options, "--prefer", "flat.obj", "--out", "again", SILENT)
    )
    assert outcome.exit_code == 0, outcome.output
    notes = json.loads(Path("again/result.json").read_text())["notes"]
    assert any("edge lengths away" in note for note in notes)
    with np.load("again/result.npz") as again, np.load(solved / "result.npz") as first:
        edges = again["edges"]
        lengths = [np.linalg.norm(f["rest"][edges[:, 0]] - f["rest"][edges[:, 1]], axis=1)
                   for f in (again, first)]  # fmt: skip
    np.testing.assert_allclose(lengths[0], lengths[1], rtol=1e-3)


def test_a_scene_file_may_name_it(solved: Path) -> None:
    scene = solved / "scene.toml"
    scene.write_text('prefer = "natural.obj"\n' + scene.read_text())
    outcome = run("invert", scene, "--out", "again", SILENT)
    assert outcome.exit_code == 0, outcome.output
    notes = json.loads(Path("again/result.json").read_text())["notes"]
    assert any(note.startswith("preferred shape") for note in notes)


def test_another_mesh_is_refused(page_file: Path, options: list[str]) -> None:
    Path("other.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    outcome = run("invert", page_file, *options, "--prefer", "other.obj", "--out", "out", SILENT)
    assert outcome.exit_code == 2
    assert "same order" in outcome.stderr
    assert not Path("out").exists()


def test_an_earlier_result_is_where_another_material_begins(
    solved: Path, options: list[str]
) -> None:
    outcome = run(
        *("invert", "page.obj", *options, "--bend", "1.2e-2", "--start", solved),
        *("--out", "again", SILENT),
    )
    assert outcome.exit_code == 0, outcome.output
    notes = json.loads(Path("again/result.json").read_text())["notes"]
    assert any("earlier natural shape" in note for note in notes)


def test_a_start_that_is_no_result_is_refused_before_any_work(
    page_file: Path, options: list[str]
) -> None:
    outcome = run("invert", page_file, *options, "--start", ".", "--out", "out", SILENT)
    assert outcome.exit_code == 2
    assert "holds no result" in outcome.output
    assert not Path("out").exists()
