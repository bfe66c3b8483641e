"""What `casashell simulate` refuses before the first step, with nothing written."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from running import run
from simulating import UNIT, steady, table, write_sequence

from casashell.io.meshes import write_mesh


@pytest.fixture
def page_folder(page_on_mesh: Path, tmp_path: Path) -> Path:
    """A copy to spoil."""
    return Path(shutil.copytree(page_on_mesh, tmp_path / "page"))


def refusal(folder: Path, *arguments: str | Path) -> str:
    """What is said on stderr; nothing else happens."""
    out = folder.parent / f"{folder.name}-simulation"
    outcome = run("simulate", folder, "--seconds", "0.2", *arguments)
    assert outcome.exit_code == 2, outcome.output
    assert not out.exists()
    assert outcome.stderr.startswith("casashell: ")
    return outcome.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("--seconds 0", "--seconds must be a positive number"),
        ("--seconds -1", "--seconds must be a positive number"),
        ("--seconds nan", "--seconds must be a positive number"),
        ("--seconds 0.001", "at least one frame"),
        ("--fps 0", "--fps must be a positive number"),
        ("--substeps 0", "--substeps must be at least 1"),
        ("--sequence-fps -3", "--sequence-fps must be"),
        ("--rest flat", "natural or target"),
        ("--formats fbx", "no format 'fbx'; known: html, obj"),
        ("--wind 1,2", "--wind 1,2: give X,Y,Z"),
        ("--wind 1,2,nan", "finite numbers"),
        ("--wind 1,0,0 --gusts 1,0", "period"),
        ("--wind 1,0,0 --gusts 1,1,0.5", "seed must be a whole number"),
        ("--wind 1,0,0 --drag -1", "drag"),
        ("--gusts 1", "need --wind"),
        ("--damping much", "--damping much"),
        ("--damping -1", "damping mass"),
        ("--keyframes hat=k.csv", "no obstacle 'hat'; the scene has: 0 (table), 1 (ball)"),
        ("--obstacle-sequence 7=k", "no obstacle '7'"),
        ("--keyframes k.csv", "say which obstacle moves"),
        ("--keyframes table=k.csv", "k.csv: No such file"),
        ("--obstacle-sequence ball=nowhere", "is a sphere"),
        ("--obstacle-sequence table=nowhere", "no numbered meshes"),
    ],
)
def test_options_that_make_no_sense(page_on_mesh: Path, arguments: str, words: str) -> None:
    assert words in refusal(page_on_mesh, *arguments.split())


def test_folders_that_are_no_result(page_folder: Path, tmp_path: Path) -> None:
    assert "no such folder" in refusal(tmp_path / "nowhere")
    (tmp_path / "empty").mkdir()
    assert "holds no result" in refusal(tmp_path / "empty")
    (page_folder / "scene.toml").unlink()
    assert "scene.toml" in refusal(page_folder)


def test_a_damaged_result(page_folder: Path) -> None:
    (page_folder / "result.npz").write_bytes(b"none")
    assert "no readable result" in refusal(page_folder)


def test_energies_that_files_do_not_keep(page_folder: Path) -> None:
    """Without its stiffness, or with forces of another energy, the scene is not what was solved."""
    with np.load(page_folder / "result.npz") as file:
        arrays = dict(file)
    other = arrays | {"forces": arrays["forces"] + 0.01}
    np.savez(page_folder / "result.npz", **other)
    assert "energies of its own" in refusal(page_folder)
    np.savez(page_folder / "result.npz", **{k: v for k, v in arrays.items() if k != "bend"})
    assert "energies of its own" in refusal(page_folder)


def test_obstacles_that_files_do_not_keep(page_folder: Path) -> None:
    scene = page_folder / "scene.toml"
    scene.write_text(scene.read_text().replace('kind = "sphere"', 'kind = "custom"'))
    assert "obstacle of a class of its own" in refusal(page_folder)


def test_a_sequence_that_ends_too_early(page_folder: Path, tmp_path: Path) -> None:
    tables = write_sequence(tmp_path / "tables", steady(12, 0.001))
    said = refusal(page_folder, "--obstacle-sequence", f"table={tables}")
    assert "0 .. 0.183333 s, the simulation 0 .. 0.2 s" in said


def test_a_sequence_of_another_topology(page_folder: Path, tmp_path: Path) -> None:
    tables = write_sequence(tmp_path / "tables", steady(13, 0.001))
    mesh = table()
    turned = mesh.faces.copy()
    turned[3] = np.roll(turned[3], 1)
    write_mesh(tables / "table_005.obj", type(mesh)(mesh.vertices, turned), unit=UNIT)
    said = refusal(page_folder, "--obstacle-sequence", f"table={tables}")
    assert "table_005.obj has other faces than obstacle 0 (table)" in said
    fewer = mesh.faces[(mesh.faces < 7).all(axis=1)]
    write_mesh(tables / "table_005.obj", type(mesh)(mesh.vertices[:7], fewer), unit=UNIT)
    said = refusal(page_folder, "--obstacle-sequence", f"table={tables}")
    assert "table_005.obj has 7 vertices, obstacle 0 (table) has 8" in said


def test_a_sequence_with_a_point_that_is_no_number(page_folder: Path, tmp_path: Path) -> None:
    tables = write_sequence(tmp_path / "tables", steady(13, 0.001))
    file = tables / "table_003.obj"
    lines = file.read_text().splitlines()
    at = next(k for k, line in enumerate(lines) if line.startswith("v "))
    lines[at + 2] = "v nan 0 0"
    file.write_text("\n".join(lines))
    said = refusal(page_folder, "--obstacle-sequence", f"table={tables}")
    assert "table_003.obj" in said
    assert "vertex 2" in said


def test_a_sequence_that_starts_elsewhere(page_folder: Path, tmp_path: Path) -> None:
    """Metres taken for centimetres, say."""
    tables = write_sequence(tmp_path / "tables", np.tile([0.0, 0.1, 0.0], (13, 1)))
    said = refusal(page_folder, "--obstacle-sequence", f"table={tables}")
    assert "must start from the scene" in said


def test_keyframes_that_are_no_numbers(page_folder: Path, tmp_path: Path) -> None:
    keys = tmp_path / "keys.csv"
    keys.write_text("time,x,y,z\n0,0,0,0\n1,nan,0,0\n")
    assert "keyframe 1: x must be a finite number" in refusal(
        page_folder, "--keyframes", f"table={keys}"
    )


def test_two_motions_for_one_obstacle(page_folder: Path, tmp_path: Path) -> None:
    keys = tmp_path / "keys.csv"
    keys.write_text("time,x,y,z\n0,0,0,0\n")
    twice = ("--keyframes", f"table={keys}", "--keyframes", f"0={keys}")
    assert "has a motion already" in refusal(page_folder, *twice)


def test_a_shell_that_starts_deep_inside_a_body(page_folder: Path, tmp_path: Path) -> None:
    """Keyframes that have the table 5 cm higher at time 0."""
    keys = tmp_path / "keys.csv"
    keys.write_text("time,x,y,z\n0,0,5,0\n")
    said = refusal(page_folder, "--keyframes", f"table={keys}")
    assert "deep inside table" in said
    assert "vertex" in said


def test_a_missing_package_is_named_before_the_run(
    page_on_mesh: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pxr", None)
    assert "pip install usd-core" in refusal(page_on_mesh, "--formats", "usd")
    monkeypatch.setitem(sys.modules, "av", None)
    assert "--formats mp4 needs av" in refusal(page_on_mesh, "--formats", "obj,mp4")


def test_results_do_not_go_where_they_are_read_from(page_folder: Path, tmp_path: Path) -> None:
    assert "which is read" in refusal(page_folder, "--out", page_folder, "--force")
    tables = write_sequence(tmp_path / "tables", steady(13, 0.0))
    sequence = ("--obstacle-sequence", f"table={tables}", "--out", tables, "--force")
    assert "which is read" in refusal(page_folder, *sequence)
    (tmp_path / "file").touch()
    assert "not a folder" in refusal(page_folder, "--out", tmp_path / "file")
