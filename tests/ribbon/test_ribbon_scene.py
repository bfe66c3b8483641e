"""Scenes: what holds, moves and guides ribbons; several at once; files to go on from."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from casashell.contact.obstacles import Plane
from casashell.ribbon.chain import reconstruct
from casashell.ribbon.collide import Collider
from casashell.ribbon.dynamics import simulate
from casashell.ribbon.holds import Attachment, HeldEnd
from casashell.ribbon.loops import circle
from casashell.ribbon.record import Progress, RunStatus
from casashell.ribbon.ribbon import Ribbon, RibbonState
from casashell.ribbon.scene import Body, Guide, Scene
from casashell.ribbon.statics import Setting
from casashell.ribbon.strips import ribbon_strip, to_vertices
from casashell.typing import FloatArray
from formulations.ribbon import ribbon_physics

PHYSICS = ribbon_physics()
H = 0.02


def free(segments: int = 6, **more: object) -> Ribbon:
    return Ribbon(0.3, 0.03, segments, stiffness=1e-3, density=0.1, ends="free", **more)


def test_a_moving_attachment_drags_the_ribbon() -> None:
    def place(t: float) -> Setting:
        return Setting(attachments=(Attachment(0.0, 0.0, (0.0, t, 0.0)),))

    sim = simulate(Scene((Body(free(), setting=place),), PHYSICS), 8 * H, H)
    assert sim.status is RunStatus.COMPLETE
    begin = sim.tracks[0].middle[:, 0]
    np.testing.assert_allclose(begin[1:, 1], sim.times[1:], atol=1e-7)
    np.testing.assert_allclose(begin[:, [0, 2]], 0.0, atol=1e-7)
    assert sim.violation.max() < 1e-7


@pytest.mark.parametrize("solver", ["ipopt", "augmented"])
def test_a_held_end_is_turned(solver: str) -> None:
    """The far end is pushed in and turned about x: both ends arrive where they are told to."""
    ribbon = Ribbon(0.3, 0.03, 8, stiffness=1e-3, density=0.1, end_crease=True)
    bend = np.full(7, 0.05) * np.sign(3.5 - np.arange(7))

    def end(t: float) -> Setting:
        c, s = np.cos(2 * t), np.sin(2 * t)
        frame = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
        return Setting(end=HeldEnd((0.298 - 0.1 * t, 0.0, 0.0), frame))

    scene = Scene((Body(ribbon, RibbonState(np.zeros(7), bend), setting=end),), PHYSICS)
    sim = simulate(scene, 2 * H, H, solver=solver, tolerance=1e-3)
    assert sim.status is RunStatus.COMPLETE, sim.message
    track, t = sim.tracks[0], sim.times[-1]
    np.testing.assert_allclose(track.middle[-1, -1], [0.298 - 0.1 * t, 0, 0], atol=1e-6)
    across = (track.top[-1, -1] - track.bottom[-1, -1]) / ribbon.width
    np.testing.assert_allclose(across, [0, np.cos(2 * t), np.sin(2 * t)], atol=1e-5)


def test_a_clamped_begin_moves() -> None:
    ribbon = Ribbon(0.3, 0.03, 6, stiffness=1e-3, density=0.1)
    body = Body(ribbon, begin=lambda t: (np.eye(3), (t, 0.0, 0.0)))
    sim = simulate(Scene((body,), PHYSICS), 4 * H, H)
    np.testing.assert_allclose(sim.tracks[0].middle[:, 0, 0], sim.times, atol=1e-12)


def test_guided_normals_follow() -> None:
    ribbon = free()

    def turned(t: float) -> tuple[float, float, float]:
        return (0.0, float(-np.sin(5 * t)), float(np.cos(5 * t)))

    guide = Guide((0, 1, 2, 3, 4, 5), turned, 1.0)
    sim = simulate(Scene((Body(ribbon, guides=(guide,)),), PHYSICS, (0, 0, 0)), 10 * H, H)
    track = sim.tracks[0]
    across = (track.top[-1, 0] - track.bottom[-1, 0]) / ribbon.width
    np.testing.assert_allclose(across, [0, np.cos(1.0), np.sin(1.0)], atol=0.02)


def test_contradictions_are_refused_before_the_first_step() -> None:
    apart = Setting(
        attachments=(Attachment(0.0, 0.0, (0, 0, 0)), Attachment(0.3, 0.0, (0.31, 0, 0)))
    )
    with pytest.raises(ValueError, match=r"lower: .*contradict"):
        Scene((Body(free()), Body(free(), setting=apart, name="lower")), PHYSICS)
    with pytest.raises(ValueError, match="thickness"):
        Scene((Body(free()),), PHYSICS, obstacles=(Plane((0, 0, 1)),))
    with pytest.raises(ValueError, match="at least one"):
        Scene((), PHYSICS)
    with pytest.raises(ValueError, match="clamped"):
        Body(Ribbon(0.3, 0.03, 6), velocity=(1, 0, 0))
    scene = Scene((Body(free()),), PHYSICS)
    for seconds, step in ((1.0, 0.0), (0.001, 0.01), (1.0, float("nan"))):
        with pytest.raises(ValueError, match="step"):
            simulate(scene, seconds, step)
    with pytest.raises(ValueError, match="solver"):
        simulate(scene, 1.0, 0.1, solver="magic")
    low = Scene((Body(free()),), PHYSICS, thickness=0.001, obstacles=(Plane((0, 0, 1), 0.1),))
    with pytest.raises(ValueError, match="inside of obstacle"):
        simulate(low, 1.0, 0.1)


def test_what_becomes_impossible_ends_the_run_with_a_sentence() -> None:
    """Two points are pulled further apart than the strip is long, at t = 0.05."""

    def pulled(t: float) -> Setting:
        return Setting(
            attachments=(Attachment(0.0, 0.0, (0, 0, 0)), Attachment(0.3, 0.0, (0.25 + t, 0, 0)))
        )

    bend = RibbonState(np.zeros(5), np.array([0.4, -0.4, -0.4, -0.4, 0.4]))
    sim = simulate(Scene((Body(free(), bend, pulled),), PHYSICS), 0.1, H)
    assert sim.status is RunStatus.FAILED
    assert "contradict" in sim.message
    assert 2 <= len(sim.times) <= 3
    assert np.all(np.isfinite(sim.tracks[0].bottom))


def test_a_loop_stays_closed_while_it_falls_and_turns() -> None:
    ribbon = Ribbon(0.3, 0.02, 10, stiffness=1e-3, density=0.1, ends="loop")
    sim = simulate(Scene((Body(ribbon, circle(ribbon), spin=(0.0, 2.0, 1.0)),), PHYSICS), 6 * H, H)
    assert sim.status is RunStatus.COMPLETE
    track = sim.tracks[0]
    np.testing.assert_allclose(track.bottom[:, -1], track.bottom[:, 0], atol=1e-7)
    np.testing.assert_allclose(track.top[:, -1], track.top[:, 0], atol=1e-7)
    drop = track.middle[-1, :-1].mean(axis=0) - track.middle[0, :-1].mean(axis=0)
    # g h^2 n (n + 1) / 2 as for any body; its rim's mean is its centre up to the change of shape
    assert drop[2] == pytest.approx(-9.81 * H**2 * 21, rel=2e-2)


def test_threads_change_nothing() -> None:
    bodies = tuple(
        Body(free(), RibbonState(np.zeros(5), np.full(5, curl)), spin=(0, 1, 0))
        for curl in (0.05, 0.1, -0.1)
    )
    runs = [simulate(Scene(bodies, PHYSICS), 3 * H, H, workers=w) for w in (1, 3)]
    for one, other in zip(runs[0].tracks, runs[1].tracks):
        np.testing.assert_array_equal(one.bottom, other.bottom)


def test_an_interrupted_run_goes_on_with_the_same_frames(tmp_path: Path) -> None:
    body = Body(free(), RibbonState(np.zeros(5), np.full(5, 0.1)), spin=(0, 2, 0))
    scene, file = Scene((body,), PHYSICS), tmp_path / "run.npz"
    whole = simulate(scene, 6 * H, H)

    def stop(progress: Progress) -> bool:
        return progress.step < 3

    part = simulate(scene, 6 * H, H, callback=stop, checkpoint=file)
    assert part.status is RunStatus.INTERRUPTED
    assert len(part.times) == 4
    rest = simulate(scene, 6 * H, H, checkpoint=file, resume=True)
    assert rest.status is RunStatus.COMPLETE
    for name, array in whole.arrays.items():
        np.testing.assert_array_equal(rest.arrays[name], array)
    np.testing.assert_array_equal(rest.inner, whole.inner)
    with pytest.raises(ValueError, match="steps of"):
        simulate(scene, 6 * H, H / 2, checkpoint=file, resume=True)
    with pytest.raises(ValueError, match="resume"):
        simulate(scene, 6 * H, H, resume=True)


def test_ctrl_c_keeps_the_frames() -> None:
    def press(progress: Progress) -> None:
        if progress.step == 2:
            raise KeyboardInterrupt

    sim = simulate(Scene((Body(free()),), PHYSICS), 6 * H, H, callback=press)
    assert sim.status is RunStatus.INTERRUPTED
    assert len(sim.times) == 3


def test_frames_file(tmp_path: Path) -> None:
    sim = simulate(
        Scene(
            (
                Body(free()),
                Body(free(4)),
            ),
            PHYSICS,
        ),
        2 * H,
        H,
    )
    with np.load(sim.save(tmp_path / "frames.npz")) as file:
        assert file["times"].shape == (3,)
        assert file["bottom_0"].shape == file["top_0"].shape == (3, 7, 3)
        assert file["slopes_1"].shape == file["angles_1"].shape == (3, 3)
        assert (float(file["length_1"]), float(file["width_1"])) == (0.3, 0.03)
        assert float(file["stiffness_0"]) == 1e-3
    with pytest.raises(ValueError, match=r"\.npz"):
        sim.save(tmp_path / "frames.txt")


def test_own_collision_response_is_called() -> None:
    """A ceiling below the start of the ribbon's way up: its vertices are put back."""

    def ground(start: Sequence[FloatArray], end: Sequence[FloatArray]) -> list[FloatArray]:
        return [np.maximum(x, [-np.inf, -np.inf, -0.01]) for x in end]

    sim = simulate(Scene((Body(free()),), PHYSICS, collide=ground), 12 * H, H)
    assert sim.status is RunStatus.COMPLETE
    assert sim.tracks[0].bottom[..., 2].min() == pytest.approx(-0.01)
    assert np.abs(sim.tracks[0].middle[-1, :, 2] + 0.01).max() < 1e-3


def test_a_ribbon_comes_to_rest_on_the_ground() -> None:
    scene = Scene(
        (Body(free()),),
        PHYSICS,
        thickness=0.002,
        obstacles=(Plane((0, 0, 1), -0.02, name="floor"),),
    )
    sim = simulate(scene, 12 * H, H)
    assert sim.status is RunStatus.COMPLETE
    heights = np.stack([sim.tracks[0].bottom, sim.tracks[0].top])[..., 2]
    assert heights.min() > -0.02
    assert np.abs(heights[:, -1] + 0.019).max() < 1e-3  # half a thickness above the floor


def test_linked_loops_stay_linked() -> None:
    """The lower loop falls into the upper one, which hangs: no faces cross, and it is caught."""
    ribbon = Ribbon(0.3, 0.01, 12, stiffness=1e-3, density=0.1, ends="loop")
    upper = circle(ribbon)
    lowest = reconstruct(ribbon, upper).middle
    radius = 0.5 * np.ptp(lowest[:, 2])
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    centre = 0.5 * (lowest.max(axis=0) + lowest.min(axis=0))
    below = turned @ (upper.origin - centre) + centre - np.array([0.0, 0.0, 1.2 * radius])
    lower = RibbonState(upper.slopes, upper.angles, turned @ upper.frame, below)
    hook = Setting(attachments=(Attachment(0.0, 0.0, lowest[0]), Attachment(0.025, 0.0, lowest[1])))
    scene = Scene((Body(ribbon, upper, hook), Body(ribbon, lower)), PHYSICS, thickness=0.001)
    sim = simulate(scene, 8 * H, H)
    assert sim.status is RunStatus.COMPLETE, sim.message
    shapes = [
        ribbon_strip(t.bottom[0], t.top[0], mass=1.0, thickness=1e-3, ends="loop")
        for t in sim.tracks
    ]
    collider = Collider(tuple(shapes))
    for f in range(len(sim.times)):
        assert not len(
            collider.crossings([to_vertices(t.bottom[f], t.top[f], "loop") for t in sim.tracks])
        )
    drop = sim.tracks[1].middle[-1].mean(axis=0)[2] - sim.tracks[1].middle[0].mean(axis=0)[2]
    assert drop > -9.81 * H**2 * 36 + 0.01  # free fall would have gone further: 36 = 8 * 9 / 2
