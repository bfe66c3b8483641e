"""Data of the player: tracks as int16 over their box, contacts as bits, curves, packed as JSON."""

from __future__ import annotations

import json
import math
from typing import Any, Final

import numpy as np

from casashell.io.animation import Animation, Track
from casashell.io.animation_camera import framing, outermost
from casashell.io.camera import directions
from casashell.io.colours import CONTACT, OBSTACLE, SHELL, SHELL_INSIDE
from casashell.io.packing import STEPS, pack, quantised
from casashell.typing import AnyArray, FloatArray

# Edges of a larger mesh would only grey it, and slow the player down.
_EDGED_FACES: Final = 15_000


def player_data(animation: Animation, megabytes: float) -> tuple[str, str]:
    """JSON for the player, and a remark on what it leaves out ("" for nothing).

    Frames are dropped evenly until positions take about ``megabytes`` in the page; the first and
    the last stay.
    """
    kept = kept_frames(animation, megabytes)
    remark = ""
    if len(kept) < animation.frames:
        remark = f"{len(kept)} of {animation.frames} frames, to keep this file small."
    times = animation.times[kept]
    camera = framing(animation)
    right, axis, front = directions(animation.up)
    every = np.concatenate([outermost(track.positions) for track in animation.tracks])
    low, high = every.min(axis=0), every.max(axis=0)
    data = {
        "times": times.tolist(),
        "frames": kept.tolist(),
        "captions": [animation.captions[frame] for frame in kept] if animation.captions else [],
        "series": [
            {"name": name, "values": _numbers(values[kept])}
            for name, values in animation.series.items()
        ],
        "tracks": [_track(track, kept) for track in animation.tracks],
        "axes": [right.tolist(), axis.tolist(), front.tolist()],
        "camera": {
            "position": camera.position.tolist(),
            "focus": camera.focus.tolist(),
            "angle": math.radians(camera.view_angle),
            "aspect": camera.aspect,
        },
        "ball": [*(0.5 * (low + high)).tolist(), 0.5 * float(np.linalg.norm(high - low))],
        "colours": {
            "shell": SHELL,
            "inside": SHELL_INSIDE,
            "body": OBSTACLE,
            "contact": CONTACT,
        },
    }
    return json.dumps(data, allow_nan=False, separators=(",", ":")), remark


def kept_frames(animation: Animation, megabytes: float) -> AnyArray:
    """Frame numbers (n,) that fit, evenly spread, with the first and the last."""
    fixed, per_frame = 0.0, 1.0
    for track in animation.tracks:
        points, lines = track.positions[0].size, 0 if track.lines is None else track.lines[0].size
        moving = track.moves and affine_motion(track) is None
        fixed += 4 * track.faces.size + (0 if moving else 2 * points)
        per_frame += 2 * ((points if moving else 24) + lines)
        per_frame += 0 if track.contact is None else points / 24
    room = 1e6 * megabytes * 3 / 4 - fixed  # base64 takes four bytes for three
    count = int(np.clip(room / per_frame, 2, animation.frames))
    picked = np.rint(np.linspace(0, animation.frames - 1, min(count, animation.frames)))
    return np.unique(picked.astype(np.int64))


def affine_motion(track: Track) -> FloatArray | None:
    """Matrices (F,4,3) that carry the first frame to every other, or None if it deforms.

    ``positions[f] = [positions[0] - center, 1] @ matrix[f]`` to within half a step of `quantised`,
    ``center`` the middle of the first frame's box.  Turning bodies are of this kind: one shape and
    twelve numbers a frame instead of all vertices.
    """
    first = track.positions[0]
    low, high = first.min(axis=0), first.max(axis=0)
    step = float((high - low).max()) / STEPS
    base = np.column_stack([first - (low + 0.5 * (high - low)), np.ones(len(first))])
    solver = np.linalg.pinv(base)
    made = np.empty((len(track.positions), 4, 3))
    for place, frame in zip(made, track.positions):
        place[:] = solver @ frame
        if np.abs(base @ place - frame).max() > 0.5 * step:
            return None
    return made


def _track(track: Track, kept: AnyArray) -> dict[str, Any]:
    motion = affine_motion(track) if track.moves else None
    still = not track.moves or motion is not None
    return {
        "name": track.name,
        "body": track.body,
        "oneSided": not track.orientable,
        "faces": pack(track.faces),
        "points": quantised(track.positions[:1] if still else track.positions[kept]),
        "still": still,
        "motion": None if motion is None else pack(motion[kept].reshape(-1, 12)),
        "lines": None if track.lines is None else quantised(track.lines[kept]),
        "contact": None if track.contact is None else pack(np.packbits(track.contact[kept])),
        "edges": not track.body and track.lines is None and len(track.faces) <= _EDGED_FACES,
    }


def _numbers(values: FloatArray) -> list[float | None]:
    """What is not finite becomes null: JSON has no word for it."""
    return [float(f"{value:.7g}") if math.isfinite(value) else None for value in values.tolist()]
