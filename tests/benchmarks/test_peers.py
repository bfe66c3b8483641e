"""The comparison with other simulators: its numbers from made-up trajectories, and its refusals."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.peers.__main__ import kept, main
from benchmarks.peers.blender_stiffness import searched
from benchmarks.peers.measures import Row, drift_at, measured, table
from benchmarks.peers.programs import Trajectory
from benchmarks.peers.scenes import THICKNESS, PeerScene, least_distance, newton_material, shrunk
from benchmarks.peers.strips import ALONG, DOWN, Strip
from casashell.app.builtin import page
from casashell.contact.obstacles import Cone, Plane, Sphere
from casashell.result import Result
from casashell.solving import solve

FPS = 60


@pytest.fixture(scope="module")
def result() -> Result:
    """A small page that arches over a table."""
    return replace(solve(page(9, 17).problem), contact_tolerance=1e-5)


@pytest.fixture(scope="module")
def folder(result: Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("peers") / "page"
    result.save(place)
    return place


def moved(result: Result, velocity: tuple[float, float, float], seconds: float) -> Trajectory:
    """The whole shell moves at a constant velocity [m/s]."""
    times = np.arange(round(seconds * FPS) + 1) / FPS
    way = times[:, None, None] * np.array(velocity)
    return Trajectory(times, result.target.vertices + way, 0.25, "made up")


def test_drift_and_creep_of_uniform_motion(result: Result) -> None:
    """Along the table at 3 mm/s and away from it at 7: both count as drift, only 3 as creep."""
    row = measured("page", "x", "ours", moved(result, (3e-3, 7e-3, 0.0), 2.0), result, (2.0, 10.0))
    size = result.target.bbox_diagonal
    assert row.drift[0] == pytest.approx(2.0 * np.hypot(3e-3, 7e-3) / size)
    assert np.isnan(row.drift[1])
    assert row.creep == pytest.approx(3e-3)
    assert row.frame_seconds == 0.25


def test_shaking_in_place_is_not_creep(result: Result) -> None:
    run = moved(result, (0.0, 0.0, 0.0), 2.0)
    shaken = run.positions.copy()
    shaken[1:-1:2, :, 0] += 1e-3
    row = measured("page", "x", "ours", replace(run, positions=shaken), result, (2.0,))
    assert row.creep == 0.0


def test_drift_is_that_of_the_moment(result: Result) -> None:
    run = moved(result, (0.01, 0.0, 0.0), 10.0)
    assert drift_at(run, 2.0, 1.0) == pytest.approx(0.02)
    assert drift_at(run, 10.0, 1.0) == pytest.approx(0.1)


def test_trajectories_that_do_not_fit_are_refused(result: Result) -> None:
    run = moved(result, (0.0, 0.0, 0.0), 1.0)
    with pytest.raises(ValueError, match=r"152 vertices, 153 expected"):
        measured("page", "x", "ours", replace(run, positions=run.positions[:, 1:]), result, ())
    broken = run.positions.copy()
    broken[7, 3, 1] = np.nan
    with pytest.raises(ValueError, match="frame 7"):
        measured("page", "x", "ours", replace(run, positions=broken), result, ())


def test_table_has_every_row_and_leaves_out_what_was_not_run() -> None:
    rows = [
        Row("page", "one", "ours", (0.5, 0.25), 2e-3, 0.125),
        Row("page", "two", "the target", (0.5, np.nan), 0.0, 1.0),
    ]
    lines = table(rows).splitlines()
    assert lines[2] == "| page | one | ours | 0.5 | 0.25 | 2 | 0.125 |"
    assert lines[3] == "| page | two | the target | 0.5 |  | 0 | 1.000 |"
    assert len({line.count("|") for line in lines}) == 1


def test_kept_trajectories_are_used_if_long_enough(result: Result, tmp_path: Path) -> None:
    run = moved(result, (0.0, 0.0, 0.0), 2.0)
    file = tmp_path / "run.npz"
    arrays = {"seconds": np.array(30.0), "frames": np.array(120), "version": np.array("kept")}
    np.savez(file, allow_pickle=False, times=run.times, positions=run.positions, **arrays)
    longer = moved(result, (0.0, 0.0, 0.0), 3.0)
    found = kept(file, 2.0, lambda: longer)
    assert (found.version, found.frame_seconds) == ("kept", 0.25)
    assert kept(file, 3.0, lambda: longer) is longer


def test_no_other_program_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(folder)]) == 2
    assert "give --blender or --newton" in capsys.readouterr().err


def test_a_python_without_the_program_is_refused(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(folder), "--blender", str(tmp_path / "none")]) == 2
    assert "is no file" in capsys.readouterr().err
    assert main([str(folder), "--newton", sys.executable]) == 2
    assert "has no newton" in capsys.readouterr().err


def test_a_folder_without_a_result_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="holds no result"):
        PeerScene.read(tmp_path)


def test_arrays_for_the_others(folder: Path, result: Result) -> None:
    scene = PeerScene.read(folder)
    ours, naive = (scene.for_newton(rest, 2.0, springs=True) for rest in ("natural", "target"))
    assert np.array_equal(ours["rest"], result.rest)
    assert np.array_equal(naive["rest"], result.target.vertices)
    assert int(ours["frames"]) == 2 * FPS
    # The page stands on its vertices: its triangles are nowhere below them.
    assert least_distance(result) == pytest.approx(0.0, abs=1e-12)
    assert scene.sink == pytest.approx(THICKNESS)
    body = scene.for_blender("natural", 2.0, {})
    assert body["vertices_0"][:, 1] == pytest.approx(-THICKNESS)


def test_hinges_and_springs_for_newton_are_ours(folder: Path, result: Result) -> None:
    """Energies of a random pose, summed as Newton does, against those of the problem."""
    scene = PeerScene.read(folder)
    made = newton_material(scene, result.rest)
    rng = np.random.default_rng(3)
    pose = result.target.vertices + 1e-4 * rng.standard_normal(result.rest.shape)
    a, b = made["edges"].T
    now, rest = (np.linalg.norm(x[b] - x[a], axis=1) for x in (pose, result.rest))
    springs = 0.5 * float((made["spring_ke"] * (now - rest) ** 2).sum())
    from casashell.engine.assembly import Assembly
    from casashell.strain import dihedral_angles

    fold = dihedral_angles(pose, made["hinges"]) - dihedral_angles(result.rest, made["hinges"])
    i, j = made["hinges"][:, :2].T
    length = np.linalg.norm(result.rest[j] - result.rest[i], axis=1)
    bending = 0.5 * float((made["edge_ke"] * length * fold**2).sum())
    for term, energy in zip(page(9, 17).problem.energies[:2], (springs, bending), strict=True):
        exact = Assembly([term], len(pose)).energy(pose, result.rest)
        assert energy == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize(
    "body",
    [
        Plane((0.0, 1.0, 0.0), 0.3),
        Cone((0.0, 1.0, 0.0), (0.0, -1.0, 0.0), 0.4),
        Sphere((0.1, 0.2, 0.3), 0.5),
    ],
    ids=lambda body: type(body).__name__,
)
def test_sunk_bodies_are_farther_by_the_depth(body: Plane | Cone | Sphere) -> None:
    values, depth = shrunk(body, 0.01), 0.01
    deeper: Plane | Cone | Sphere
    if isinstance(body, Plane):
        deeper = Plane(tuple(values[:3]), values[3])
    elif isinstance(body, Cone):
        deeper = Cone(tuple(values[:3]), tuple(values[3:6]), values[6], length=values[7])
    else:
        deeper = Sphere(tuple(values[:3]), values[3])
    points = np.random.default_rng(1).uniform(-0.3, 0.3, (40, 3)) + np.array([1.2, 0.4, 0.0])
    more = deeper.signed_distance(points)[0] - body.signed_distance(points)[0]
    assert more == pytest.approx(np.full(40, depth), abs=1e-12)


def test_strip_is_stretched_by_its_weight_as_springs_are() -> None:
    """Twice the weight, twice as much; and by the force that passes the clamp, within a factor of 2."""
    strip = Strip.of(0.1)
    one, two = (strip.longer(strip.at_rest(w, 100.0, 1e-3, ALONG)) for w in (1e-3, 2e-3))
    assert two == pytest.approx(2.0 * one, rel=1e-3)
    # Mean force: half of 7 rows of 3 vertices; four edges a row carry cos^2(30 deg) of k_L each.
    assert 0.5 < one / (0.5 * 21e-3 / (4.0 * 0.75 * 100.0)) < 2.0


def test_strip_sags_as_a_beam() -> None:
    """Half as much when twice as stiff; near q L^4 / (8 B b), B = 3 k_theta on equilateral triangles.

    Two triangles are a narrow beam, whose rims lack hinges: it is softer, by less than a factor of 2.
    """
    strip = Strip.of(0.1)
    one, two = (strip.sag(strip.at_rest(1e-5, 1e3, bend, DOWN)) for bend in (1e-2, 2e-2))
    assert one == pytest.approx(2.0 * two, rel=1e-3)
    line = 3.0 * 1e-5 / (0.5 * np.sqrt(3.0) * 0.1)
    beam = line * strip.free_length**4 / (8.0 * 3.0 * 1e-2 * 0.2)
    assert 1.0 < one * strip.free_length / beam < 2.0


def test_rolled_strip_keeps_its_rows() -> None:
    strip = Strip.of(0.1)
    rolled = strip.rolled(0.1)
    rows = np.linalg.norm(rolled[3::3] - rolled[:-3:3], axis=1)
    flat = np.linalg.norm(strip.mesh.vertices[3::3] - strip.mesh.vertices[:-3:3], axis=1)
    assert rows == pytest.approx(flat)
    assert strip.mean_fold(strip.mesh.vertices) == pytest.approx(0.0, abs=1e-12)
    assert abs(strip.mean_fold(rolled)) > 0.05


@pytest.mark.parametrize("power", [-1.0, 1.0])
def test_search_finds_the_number(power: float) -> None:
    found = searched(lambda x: min(2.0 * x**power, 50.0), 0.01, 3.0, tolerance=1e-3)
    assert 2.0 * found**power == pytest.approx(3.0, rel=2e-3)


def test_search_out_of_reach_says_so() -> None:
    with pytest.raises(RuntimeError, match="nothing within"):
        searched(lambda x: 1.0, 1.0, 3.0)
