"""Checkpoints, interrupts, files, and what is refused before the first step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from meshes import grid, rolled
from posed import sheet

from casashell.contact.obstacles import Plane, Sphere
from casashell.dynamics.simulate import simulate
from casashell.dynamics.simulation import (
    EXTRA_KEYS,
    FRAME_KEYS,
    Frame,
    Simulation,
    SimulationStatus,
)
from casashell.problem import Problem
from casashell.result import Result
from formulations.wind import FaceWind

BREEZE = FaceWind((1.0, 0.5, 0.0), gust=0.4)


def landing() -> Result:
    """A bent sheet that falls on a floor."""
    bent = rolled(grid(4, 2, 0.05, 0.05), 0.05, 0.3)
    low = float(bent.vertices[:, 2].min())
    lifted = bent.moved(bent.vertices + np.array([0.0, 0.0, 0.01 - low]))
    return sheet(lifted, (Plane((0.0, 0.0, 1.0), 0.0, 0.5),))


class Killed(RuntimeError):
    """What ends a run from outside."""


def killed_at(number: int) -> Callable[[Frame], None]:
    def callback(frame: Frame) -> None:
        if frame.number == number:
            raise Killed

    return callback


@pytest.mark.parametrize("at", [0, 13, 20])
def test_a_killed_run_goes_on_with_the_same_frames(tmp_path: Path, at: int) -> None:
    whole = simulate(landing(), 0.5, wind=BREEZE)
    with pytest.raises(Killed):
        simulate(landing(), 0.5, wind=BREEZE, checkpoint=tmp_path / "run", callback=killed_at(at))
    again = simulate(landing(), 0.5, wind=BREEZE, checkpoint=tmp_path / "run")
    for name in (*FRAME_KEYS, *EXTRA_KEYS):
        assert np.array_equal(getattr(whole, name), getattr(again, name)), name
    assert any("taken up again" in note for note in again.notes)
    done = simulate(landing(), 0.5, wind=BREEZE, checkpoint=tmp_path / "run")
    assert np.array_equal(done.positions, whole.positions)


def test_a_finished_run_can_be_made_longer(tmp_path: Path) -> None:
    simulate(landing(), 0.4, checkpoint=tmp_path)
    longer = simulate(landing(), 0.6, checkpoint=tmp_path)
    assert np.array_equal(longer.positions, simulate(landing(), 0.6).positions)


def test_the_checkpoint_of_another_run_is_refused(tmp_path: Path) -> None:
    simulate(landing(), 0.2, checkpoint=tmp_path)
    for other in ({"wind": BREEZE}, {"fps": 30}, {"velocity": (0.1, 0, 0)}, {"substeps": 2}):
        with pytest.raises(ValueError, match="another simulation"):
            simulate(landing(), 0.2, checkpoint=tmp_path, **other)
    strange = tmp_path / "strange"
    strange.mkdir()
    (strange / "letter.txt").write_text("dear")
    with pytest.raises(ValueError, match="not empty"):
        simulate(landing(), 0.2, checkpoint=strange)


def test_an_interrupt_returns_what_there_is() -> None:
    def stop(frame: Frame) -> None:
        if frame.number == 5:
            raise KeyboardInterrupt

    run = simulate(landing(), 0.5, callback=stop)
    assert run.status is SimulationStatus.INTERRUPTED
    assert run.status.exit_code == 130
    assert len(run.times) == len(run.positions) == 6
    assert np.array_equal(run.positions, simulate(landing(), 0.1).positions[:6])


def test_frames_are_told_as_they_are_kept(tmp_path: Path) -> None:
    told: list[Frame] = []
    run = simulate(landing(), 0.2, callback=told.append)
    assert [frame.number for frame in told] == list(range(13))
    assert np.array_equal([frame.positions for frame in told], run.positions)
    file = run.save(tmp_path / "frames.npz")
    with np.load(file, allow_pickle=False) as stored:
        assert stored["times"].shape == (13,)
        assert stored["positions"].shape == stored["velocities"].shape == (13, 15, 3)
        assert stored["contact"].shape == (13, 15)
        assert stored["contact"].dtype == bool
        assert stored["faces"].shape == (16, 3)
    again = Simulation.load(tmp_path)
    assert again.status is run.status
    assert np.array_equal(again.positions, run.positions)
    with pytest.raises(ValueError, match="does not exist"):
        Simulation.load(tmp_path / "nowhere")


def test_what_cannot_be_simulated_is_refused() -> None:
    result = landing()
    count = len(result.rest)
    for change, words in (
        ({"rest": np.zeros((3, 3))}, "rest must have"),
        ({"rest": np.full((count, 3), np.nan)}, "rest: vertex 0"),
        ({"rest": "flat"}, "rest must be one of"),
        ({"seconds": 0.0}, "seconds"),
        ({"fps": np.nan}, "fps"),
        ({"substeps": 0}, "substeps"),
        ({"wind": "north"}, "wind"),
        ({"mass": 0.0}, "no mass"),
        ({"mass": np.full(count, -1.0)}, "mass of vertex 0"),
        ({"velocity": np.zeros(2)}, "velocity"),
    ):
        with pytest.raises(ValueError, match=words):
            simulate(result, **{"seconds": 0.1, **change})  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="problem="):
        simulate(replace(result, energies=()), 0.1)


def test_a_result_from_a_file_takes_its_energies_from_the_problem() -> None:
    result = landing()
    terms, bare = result.energies, replace(result, energies=())
    problem = Problem(result.target, terms, result.obstacles)
    run = simulate(bare, 0.1, problem=problem)
    assert np.array_equal(run.positions, simulate(result, 0.1).positions)
    shifted = result.target.moved(result.target.vertices + 0.1)
    with pytest.raises(ValueError, match="another target"):
        simulate(bare, 0.1, problem=Problem(shifted, terms, result.obstacles))
    with pytest.raises(ValueError, match="pins other"):
        simulate(bare, 0.1, problem=Problem(result.target, terms, result.obstacles, [0]))


def test_a_start_deep_inside_a_body_is_refused() -> None:
    inside = sheet(grid(4, 4, 0.05, 0.05), (Sphere((0.1, 0.1, 0.0), 0.08, name="ball"),))
    with pytest.raises(ValueError, match=r"vertex 12 starts 0\.08 m deep inside ball"):
        simulate(inside, 0.1)


def test_a_shell_without_density_says_what_to_give() -> None:
    result = landing()
    bare = replace(result, energies=tuple(t for t in result.energies if t.name != "gravity"))
    with pytest.raises(ValueError, match="mass="):
        simulate(bare, 0.1)
    run = simulate(bare, 0.1, mass=0.001)
    assert run.status is SimulationStatus.COMPLETE
    assert run.drift.max() <= 1e-12
