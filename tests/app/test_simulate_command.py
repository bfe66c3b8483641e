"""`casashell simulate`: holding, moving, files, resuming, interrupts."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
from running import SILENT, run
from simulating import UNIT
from typer.testing import Result

from casashell.app.simulate_display import Clock, duration, live_text
from casashell.dynamics.simulation import Frame, Simulation

#: What a shell that holds may drift, in its size.
HELD = 1e-6


def simulated(*arguments: str | Path) -> Result:
    """Outcome of ``casashell simulate arguments`` without the picture."""
    return run("simulate", *arguments, SILENT)


def record(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "simulation.json").read_text())
    return found


def test_a_solved_page_holds_and_is_written(page_on_mesh: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    outcome = simulated(page_on_mesh, "--seconds", "1", "--fps", "20", "--out", out)
    assert outcome.exit_code == 0, outcome.output
    assert "COMPLETE" in outcome.stdout
    assert "(holds)" in outcome.stdout
    found = record(out)
    assert found["status"] == "COMPLETE"
    assert found["drift"]["largest"] <= HELD
    assert found["speed"]["contacts_last_second"] <= 1e-9
    status = json.loads((page_on_mesh / "result.json").read_text())["status"]
    assert found["settings"]["result_status"] == status
    with np.load(out / "frames.npz", allow_pickle=False) as frames:
        assert frames["times"].tolist() == pytest.approx(np.arange(21) / 20)
        assert frames["positions"].shape == frames["velocities"].shape == (21, 42, 3)
        assert frames["contact"].dtype == np.bool_
        assert frames["contact"].sum(axis=1).tolist() == [12] * 21  # both long edges stand
        with np.load(page_on_mesh / "result.npz") as result:
            np.testing.assert_array_equal(frames["faces"], result["faces"])
            np.testing.assert_array_equal(frames["positions"][0], result["pose"])
    assert {item.name for item in out.iterdir()} == {"frames.npz", "simulation.json", "player.html"}


def test_with_the_design_as_natural_shape_it_moves(page_on_mesh: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    outcome = simulated(
        *(page_on_mesh, "--seconds", "0.2", "--rest", "target", "--out", out, "--json")
    )
    assert outcome.exit_code == 0, outcome.output
    printed = json.loads(outcome.stdout)
    assert printed == record(out)
    assert printed["drift"]["largest"] >= 1000 * HELD


def test_wind_blows_the_page_along(page_on_mesh: Path, tmp_path: Path) -> None:
    """Gusts of one seed are the same twice, of another they are not."""
    ends = []
    for name, seed in (("a", "3"), ("b", "3"), ("c", "4")):
        air = ("--wind", "40,0,0", "--gusts", f"0.3,0.2,{seed}", "--lift", "0.2")
        line = (page_on_mesh, "--seconds", "0.1", *air, "--out", tmp_path / name)
        outcome = simulated(*line)
        assert outcome.exit_code == 0, outcome.output
        assert "seed" in outcome.stdout
        ends.append(Simulation.load(tmp_path / name).positions[-1])
    assert record(tmp_path / "a")["settings"]["wind"]["lift"] == 0.2
    assert (ends[0] - Simulation.load(tmp_path / "a").positions[0])[:, 0].mean() > 1e-6
    np.testing.assert_array_equal(ends[0], ends[1])
    assert np.abs(ends[0] - ends[2]).max() > 1e-9


def test_damping_takes_speed(page_on_mesh: Path, tmp_path: Path) -> None:
    speeds = []
    for name, damping in (("free", "0"), ("damped", "50,0.01")):
        line = (page_on_mesh, "--seconds", "0.1", "--rest", "target")
        outcome = simulated(*line, "--damping", damping, "--out", tmp_path / name)
        assert outcome.exit_code == 0, outcome.output
        speeds.append(record(tmp_path / name)["speed"]["largest"])
    assert speeds[1] < 0.9 * speeds[0]


def test_mesh_series_are_in_the_unit_of_the_input(page_on_mesh: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    line = (page_on_mesh, "--seconds", "0.1", "--fps", "20", "--rest", "target")
    outcome = simulated(*line, "--out", out, "--formats", "obj,vtk,html,obj")
    assert outcome.exit_code == 0, outcome.output
    frames = Simulation.load(out).positions
    (last,) = (path for path in (out / "obj").glob("page_0002.obj"))
    read = meshio.read(last).points
    np.testing.assert_allclose(UNIT * read, frames[2], rtol=1e-12, atol=1e-15)
    assert (out / "obj" / "ball.obj").is_file()
    assert (out / "vtk" / "animation.pvd").is_file()


def test_folders_are_refused_forced_and_cleared(page_on_mesh: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    line = (page_on_mesh, "--seconds", "0.05", "--out", out)
    assert simulated(*line, "--formats", "obj", "--quiet").stdout == ""
    own = out / "notes.txt"
    own.write_text("mine")
    before = (out / "frames.npz").read_bytes()
    again = simulated(*line)
    assert again.exit_code == 2
    assert "--force" in again.stderr
    assert simulated(*line, "--resume").exit_code == 2
    assert simulated(*line, "--resume", "--force").exit_code == 2
    refused = simulated(*line, "--force", "--keyframes", "nobody=keys.csv")
    assert refused.exit_code == 2
    assert (out / "frames.npz").read_bytes() == before
    forced = simulated(*line, "--force")
    assert forced.exit_code == 0, forced.output
    assert not (out / "obj").exists()
    assert own.read_text() == "mine"


def test_the_default_folder_is_beside_the_result(page_on_mesh: Path, tmp_path: Path) -> None:
    place = tmp_path / "page"
    shutil.copytree(page_on_mesh, place)
    outcome = simulated(place, "--seconds", "0.05", "--quiet")
    assert outcome.exit_code == 0, outcome.output
    assert (tmp_path / "page-simulation" / "frames.npz").is_file()


def started(line: list[str | Path], kept: Path, frames: int) -> subprocess.Popen[str]:
    """The program in a process of its own, when it has made that many frames."""
    size = 42 * (2 * 3 * 8 + 1) + 5 * 8  # bytes of a frame: positions, velocities, contact, numbers
    process = subprocess.Popen(
        [sys.executable, "-m", "casashell", "simulate", *map(str, line)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )
    for _ in range(600):
        if kept.is_file() and kept.stat().st_size >= frames * size:
            return process
        if process.poll() is not None:
            break
        time.sleep(0.05)
    process.kill()
    raise RuntimeError(f"no frames: {process.communicate()}")


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_a_stopped_run_is_resumed_with_the_same_frames(
    page_on_mesh: Path, tmp_path: Path, how: signal.Signals
) -> None:
    out = tmp_path / "out"
    line = [page_on_mesh, "--rest", "target", "--out", out, "--fps", "120"]
    process = started([*line, "--seconds", "60"], out / "checkpoint" / "frames.bin", 15)
    process.send_signal(how)
    said = process.communicate(timeout=60)
    if how is signal.SIGINT:
        assert process.returncode == 130, said
        assert record(out)["status"] == "INTERRUPTED"
        assert str(Simulation.load(out).status) == "INTERRUPTED"
        assert "INTERRUPTED" in (out / "player.html").read_text()
    else:
        assert not (out / "frames.npz").exists()
    assert "--resume" in simulated(*line, "--seconds", "0.25").stderr
    kept = np.load(out / "checkpoint" / "state.npz")["frames"]
    resumed = simulated(*line, "--seconds", f"{(kept + 20) / 120}", "--resume")
    assert resumed.exit_code == 0, resumed.output
    assert "taken up again" in resumed.stdout
    assert not (out / "checkpoint").exists()
    whole = tmp_path / "whole"
    straight = [*line[:3], "--out", whole, "--fps", "120", "--seconds", f"{(kept + 20) / 120}"]
    assert simulated(*straight).exit_code == 0
    one, other = Simulation.load(out), Simulation.load(whole)
    np.testing.assert_array_equal(one.positions, other.positions)
    np.testing.assert_array_equal(one.velocities, other.velocities)


def test_a_checkpoint_of_another_run_is_not_taken_up(
    page_on_mesh: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    line = (page_on_mesh, "--seconds", "0.2", "--out", out)

    def stop(self: Clock, frame: Frame) -> None:
        if frame.number == 3:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Clock, "tick", stop)
        assert simulated(*line).exit_code == 130
    assert len(Simulation.load(out).times) == 4
    other = simulated(*line, "--resume", "--wind", "1,0,0")
    assert other.exit_code == 2
    assert "another simulation" in other.stderr
    assert simulated(*line, "--resume").exit_code == 0


def test_a_step_that_fails_leaves_what_there_is(
    page_on_mesh: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from casashell.dynamics.stepper import Stepper

    advance = Stepper.advance

    def failing(self: Stepper, state: Any, h: float, end: float, *more: Any, **named: Any) -> bool:
        return end < 0.05 and advance(self, state, h, end, *more, **named)

    monkeypatch.setattr(Stepper, "advance", failing)
    out = tmp_path / "out"
    outcome = simulated(page_on_mesh, "--seconds", "0.2", "--out", out, "--quiet")
    assert outcome.exit_code == 1
    assert "FAILED" in outcome.stderr
    assert record(out)["status"] == "FAILED"
    assert 1 <= len(Simulation.load(out).times) <= 4


def test_films_usd_and_the_picture_of_the_end(page_on_mesh: Path, tmp_path: Path) -> None:
    for name in ("pyvista", "av", "pxr", "matplotlib", "PIL"):
        pytest.importorskip(name)
    out = tmp_path / "out"
    line = (page_on_mesh, "--seconds", "0.1", "--fps", "10", "--out", out)
    outcome = run("simulate", *line, "--formats", "usd,gif")
    assert outcome.exit_code == 0, outcome.output
    assert (out / "animation.gif").read_bytes()[:3] == b"GIF"
    assert (out / "animation.usdc").read_bytes()[:8] == b"PXR-USDC"
    from PIL import Image

    picture = np.asarray(Image.open(out / "first-last.png").convert("L"), dtype=float)
    assert picture.std() > 5.0  # something is to be seen


def test_the_live_line_tells_frame_speed_contacts_and_time_left() -> None:
    still = np.zeros((4, 3))
    clock = Clock()
    for number, seconds in ((0, 1.0), (1, 3.0)):
        contact = np.array([True, False, False, True])
        velocities = np.tile([0.03, 0.0, 0.04], (4, 1))
        numbers = (0.0, 0.0, 0.0, 2, 3, seconds)
        frame = Frame(number, 61, number / 60, still, velocities, contact, *numbers)
        clock.tick(frame)
    assert live_text(frame, clock) == (
        "frame 1 of 60, fastest 50.0 mm/s, 2 contacts, 1 min 58 s left"  # 59 frames of 2 s
    )
    assert clock.step_seconds == pytest.approx(1.0)
    assert [duration(s) for s in (14.2, 185, 7800)] == ["14 s", "3 min 05 s", "2 h 10 min"]


def test_a_real_hat_holds(shared_data: Path, tmp_path: Path) -> None:
    """Unit and tolerance are those of the scene; the drift is what a simulation has to keep."""
    data, out = shared_data / "hat_on_sphere", tmp_path / "hat"
    scene = ("--obstacle", data / "obstacle.obj", "--unit", "dm", "--tolerance", "0.039")
    solved = run("invert", data / "shell.obj", *scene, "--out", out, SILENT)
    assert solved.exit_code == 0, solved.output
    line = (out, "--seconds", "0.1")
    held = simulated(*line)
    assert held.exit_code == 0, held.output
    numbers = record(tmp_path / "hat-simulation")
    assert numbers["drift"]["largest"] <= HELD
    assert numbers["speed"]["contacts_last_second"] <= 1e-9
    moved = simulated(*line, "--rest", "target", "--out", tmp_path / "naive", "--json")
    assert json.loads(moved.stdout)["drift"]["largest"] >= 1000 * HELD
