"""Files of a ribbon simulation: frames, record, player and the other formats."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from casashell.app.ribbon_measures import strip_of, total_energy, vertices_at
from casashell.app.ribbon_setup import RibbonSetup
from casashell.app.simulate_output import owned_paths as owned_formats
from casashell.io.animation import Animation, Track
from casashell.io.tessellate import Region, tessellate
from casashell.ribbon.record import RibbonSimulation, RunStatus

FRAMES, RECORD = "frames.npz", "ribbon.json"


def owned_paths(folder: Path) -> list[Path]:
    """Everything in ``folder`` that an older run has written."""
    record = folder / RECORD
    return [*owned_formats(folder), *([record] if record.exists() else [])]


def animation_of(setup: RibbonSetup, simulation: RibbonSimulation) -> Animation:
    """Ribbons with their rulings, obstacles, and curves of energies and iterations."""
    tracks, count = [], len(simulation.times)
    shapes = [vertices_at(setup, simulation, frame) for frame in range(count)]
    for k, body in enumerate(setup.scene.bodies):
        kept = simulation.tracks[k]
        points = np.stack([shape[k] for shape in shapes])
        rulings = np.stack([kept.bottom, kept.top], axis=2)
        faces = strip_of(body, 0.01 * body.ribbon.width).faces
        tracks.append(Track(kept.name or f"ribbon {k}", points, faces, lines=rulings))
    low = np.min([track.positions.min(axis=(0, 1)) for track in tracks], axis=0)
    high = np.max([track.positions.max(axis=(0, 1)) for track in tracks], axis=0)
    region = Region.around(low, high, scale=1.25)
    taken = {track.name for track in tracks}
    for number, obstacle in enumerate(setup.scene.obstacles):
        label = obstacle.name or f"obstacle {number}"
        label = f"{label} ({number})" if label in taken else label
        taken.add(label)
        surface = tessellate(obstacle, region)
        tracks.append(Track.still(label, surface.vertices, surface.faces, count))
    state = simulation.status
    title = setup.name if state is RunStatus.COMPLETE else f"{setup.name} ({state}, not complete)"
    return Animation(
        simulation.times,
        tuple(tracks),
        setup.up,
        title,
        _captions(simulation),
        _series(simulation),
    )


def _captions(simulation: RibbonSimulation) -> tuple[str, ...]:
    segments = sum(track.ribbon.segments for track in simulation.tracks)
    ribbons = len(simulation.tracks)
    words = f"{segments} segments" if ribbons == 1 else f"{ribbons} ribbons, {segments} segments"
    counts = zip(simulation.inner.mean(axis=1), simulation.outer.mean(axis=1), simulation.seconds)
    return tuple(
        words if not seconds else f"{words}; {inner:.0f} / {outer:.0f} iterations, {seconds:.2f} s"
        for inner, outer, seconds in counts
    )


def _series(simulation: RibbonSimulation) -> dict[str, Any]:
    energy = total_energy(simulation)
    energy[np.abs(energy) < 1e-12 * np.abs(energy).max()] = 0.0  # rounding of what is at rest
    names = ("kinetic", "elastic", "weight", "total")
    curves: dict[str, Any] = {f"{name} energy (J)": row for name, row in zip(names, energy.T)}
    steps: dict[str, Any] = {
        "inner iterations, mean": simulation.inner.mean(axis=1),
        "outer iterations, mean": simulation.outer.mean(axis=1),
        "time of the step (s)": simulation.seconds.copy(),
    }
    for row in steps.values():
        row[0] = np.nan  # nothing was solved for the first frame
    return curves | steps
