"""`casashell ribbon`: files, exit codes, resuming."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from running import run

from casashell.app import ribbon_run
from casashell.app.ribbon_measures import notes_on

SCENE = """
name = "flag"
seconds = 0.05
step = 0.01
[[ribbon]]
name = "strip"
length = 0.2
width = 0.03
segments = 8
stiffness = 2.7e-4
density = 0.08
"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """A small cantilever."""
    path = tmp_path / "flag.toml"
    path.write_text(SCENE)
    return path


def test_files_of_a_run(scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    outcome = run("ribbon", scene, "--out", out, "--formats", "obj,vtk")
    assert outcome.exit_code == 0, outcome.output
    with np.load(out / "frames.npz") as frames:
        assert np.allclose(frames["times"], 0.01 * np.arange(6))
        assert frames["bottom_0"].shape == frames["top_0"].shape == (6, 9, 3)
        assert frames["slopes_0"].shape == frames["angles_0"].shape == (6, 7)
        sizes = [float(frames[f"{name}_0"]) for name in ("length", "width", "stiffness")]
        assert sizes == [0.2, 0.03, 2.7e-4]
        assert frames["bottom_0"][-1, -1, 2] < -1e-3  # it falls
    record = json.loads((out / "ribbon.json").read_text())
    assert record["status"] == "COMPLETE"
    assert record["frames"] == 6
    assert record["isometry_error"] < 1e-12
    assert record["inner_iterations"]["mean"] >= 1
    assert record["frames_with_crossings"] == 0
    assert "energy" in (out / "player.html").read_text()
    assert len(list((out / "obj").glob("strip_0*.obj"))) == 6
    assert (out / "vtk" / "animation.pvd").is_file()
    assert not (out / "checkpoint").exists()


def test_step_seconds_and_solver_override_the_scene(scene: Path, tmp_path: Path) -> None:
    arguments = ("--seconds", "0.04", "--step", "0.02", "--solver", "augmented", "--json")
    outcome = run("ribbon", scene, "--out", tmp_path / "out", *arguments)
    assert outcome.exit_code == 0, outcome.output
    record = json.loads(outcome.stdout)
    assert record["frames"] == 3
    assert record["settings"]["solver"] == "augmented"
    assert record["settings"]["resample"] == "linear"


def test_a_folder_with_files_is_refused_and_replaced_by_force(scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "frames.npz").write_text("old")
    (out / "mine.txt").write_text("kept")
    outcome = run("ribbon", scene, "--out", out)
    assert outcome.exit_code == 2
    assert "--force" in outcome.output
    assert (out / "frames.npz").read_text() == "old"
    assert run("ribbon", scene, "--out", out, "--force", "--quiet").exit_code == 0
    assert (out / "mine.txt").read_text() == "kept"
    assert np.load(out / "frames.npz")["times"].shape == (6,)


def test_a_stopped_run_resumes_with_the_same_frames(
    scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run("ribbon", scene, "--out", tmp_path / "whole", "-q").exit_code == 0
    real = ribbon_run.simulate

    def stopped(*given, callback, **named):  # type: ignore[no-untyped-def]
        return real(*given, callback=lambda p: p.step < 2, **named)

    out = tmp_path / "out"
    monkeypatch.setattr(ribbon_run, "simulate", stopped)
    outcome = run("ribbon", scene, "--out", out, "--formats", "obj")
    assert outcome.exit_code == 130, outcome.output
    assert len(np.load(out / "frames.npz")["times"]) == 3
    assert json.loads((out / "ribbon.json").read_text())["status"] == "INTERRUPTED"
    monkeypatch.setattr(ribbon_run, "simulate", real)
    other = run("ribbon", scene, "--out", out, "--resume", "--solver", "augmented")
    assert other.exit_code == 2
    assert "solver" in other.output
    assert run("ribbon", scene, "--out", out, "--resume", "-q").exit_code == 0
    with np.load(out / "frames.npz") as found, np.load(tmp_path / "whole/frames.npz") as whole:
        assert set(found) == set(whole)
        for name in whole:
            assert np.array_equal(found[name], whole[name]), name
    assert run("ribbon", scene, "--out", out, "--resume").exit_code == 2  # nothing is left to do


def test_ctrl_c_keeps_what_there_is(scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    call = [sys.executable, "-m", "casashell", "ribbon", scene, "--seconds", "1000", "--out", out]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen(call, env=environment, stderr=subprocess.PIPE) as process:
        kept = out / "checkpoint" / "ribbons.npz"
        until = time.monotonic() + 60
        while not kept.exists() and process.poll() is None and time.monotonic() < until:
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 130
    assert len(np.load(out / "frames.npz")["times"]) > 1
    assert (out / "player.html").is_file()


def test_the_scenes_are_listed() -> None:
    names = ["moebius", "cantilever", "helix", "torsion", "dragging", "falling"]
    outcome = run("ribbon", "--list", "--json")
    assert outcome.exit_code == 0
    listed = json.loads(outcome.stdout)
    assert [row["name"] for row in listed] == [*names, "double-chain", "moebius-chain"]
    text = run("ribbon", "--list").stdout
    assert all(row["about"] in text for row in listed)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["mobius"], "did you mean 'moebius'"),
        (["nowhere.toml"], "No such file"),
        ([], "--list"),
        (["cantilever", "--solver", "newton"], "augmented or ipopt"),
        (["cantilever", "--step", "0"], "step must be a positive"),
        (["cantilever", "--step", "1e-12"], "take longer steps"),
        (["cantilever", "--seconds", "0.001"], "less than one step"),
        (["cantilever", "--formats", "avi"], "no format 'avi'"),
        (["cantilever", "--resume"], "no unfinished run"),
        (["torsion", "--step", "2"], "guide 0 turns by"),
    ],
)
def test_bad_arguments_end_before_any_work(
    arguments: list[str], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    outcome = run("ribbon", *arguments)
    assert outcome.exit_code == 2, outcome.output
    assert words in outcome.output
    assert "Traceback" not in outcome.output
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("segments = 8", "segments = 100000", "take fewer segments"),
        ("step = 0.01", "step = 0.01\nthickness = 0.1", "take a smaller thickness"),
        (
            "width = 0.03",
            'width = 0.114\nends = "moebius"\nstart.shape = "moebius"',
            "take more segments",
        ),
    ],
)
def test_scenes_that_cannot_work_say_what_to_change(
    old: str, new: str, words: str, scene: Path, tmp_path: Path
) -> None:
    scene.write_text(SCENE.replace(old, new))
    outcome = run("ribbon", scene, "--out", tmp_path / "out")
    assert outcome.exit_code == 2, outcome.output
    assert words in " ".join(outcome.output.split())
    assert not (tmp_path / "out").exists()


def test_a_complete_run_says_what_went_wrong_on_the_way() -> None:
    assert notes_on({"isometry_error": 1e-3, "frames_with_crossings": 0}) == []
    stretched, crossed = notes_on({"isometry_error": 0.03, "frames_with_crossings": 4})
    assert "off by 3 %" in stretched
    assert "pass through" in crossed
