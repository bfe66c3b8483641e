"""A small animation for the writers: a strip that waves, a block that turns, a floor that stands."""

from __future__ import annotations

import numpy as np

from casashell.io.animation import Animation, Track
from casashell.typing import FloatArray, IntArray

FPS = 30.0


def strip(columns: int) -> tuple[FloatArray, IntArray]:
    """Flat strip of ``2 columns`` vertices along x, 1 m by 0.2 m, its front up (y)."""
    x = np.linspace(-0.5, 0.5, columns)
    far = np.stack([x, np.zeros(columns), np.full(columns, -0.1)], axis=1)
    near = far + np.array([0.0, 0.0, 0.2])
    n = np.arange(columns - 1)
    faces = [np.stack([n, n + columns, n + 1], axis=1)]
    faces.append(np.stack([n + 1, n + columns, n + columns + 1], axis=1))
    return np.concatenate([far, near]), np.concatenate(faces)


def moving(frames: int = 6, columns: int = 8, up: str = "y") -> Animation:
    """Strip "a/b" with rulings, contacts and a natural shape, block and floor as bodies."""
    flat, faces = strip(columns)
    times = np.arange(frames) / FPS
    phase = 6.0 * flat[None, :, 0] + 9.0 * times[:, None]
    positions = np.repeat(flat[None], frames, axis=0)
    positions[:, :, 1] += 0.3 + 0.1 * np.sin(phase)
    rulings = np.stack([positions[:, :columns], positions[:, columns:]], axis=2)
    corners = np.array([[-1, 0, -1], [1, 0, -1], [0, 0, 1], [0, 1, 0]]) * 0.15
    sides = np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]])
    turned = np.stack([corners @ _turn(time).T for time in times])
    floor = np.array([[-1.0, -0.1, -1.0], [1.0, -0.1, -1.0], [0.0, -0.1, 1.0]])
    tracks = (
        Track("a/b", positions, faces, flat, rulings, np.sin(phase) < -0.5),
        Track("block", turned, sides, body=True),
        Track.still("floor", floor, np.array([[0, 2, 1]]), frames),
    )
    axes = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
    captions = tuple(f"frame {n}" for n in range(frames))
    energy = np.linspace(1.0, 0.5, frames)
    energy[0] = np.nan
    return Animation(
        times, tracks, axes[up], "Strip </script> & block", captions, {"energy": energy}
    )


def _turn(angle: float) -> FloatArray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
