"""What all animation writers take: moving surfaces over time, captions and curves.  Lengths in metres."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final

import numpy as np

from casashell.io.camera import directions
from casashell.mesh import TriMesh
from casashell.typing import AnyArray, ArrayLike, BoolArray, FloatArray, IntArray

# Frames further apart than this share of the frame time are not "evenly spaced".
_EVEN: Final = 1e-6


@dataclass(frozen=True, eq=False)
class Track:
    """One moving surface.

    name         not empty, its own within the animation
    positions    (F,V,3) m, every frame
    faces        (T,3) vertex ids from 0
    rest         (V,3) m natural shape, or None
    rest_angles  (H,) rad natural dihedral angles in the order of ``mesh.hinges``, where they are not
                 those of ``rest``
    lines        (F,L,2,3) m segments drawn on the surface, such as the rulings of a ribbon
    contact      (F,V) whether a vertex touches something; coloured in the player
    body         an obstacle: drawn muted

    Arrays are not copied: a still surface can be ``np.broadcast_to`` of one frame, see `still`.
    ValueError names the track, the array, and the frame and vertex at fault.
    """

    name: str
    positions: FloatArray
    faces: IntArray
    rest: FloatArray | None = None
    lines: FloatArray | None = None
    contact: BoolArray | None = None
    body: bool = False
    rest_angles: FloatArray | None = None

    def __post_init__(self) -> None:
        if not self.name.strip():
            raise ValueError("a track needs a name")
        positions = self._real(self.positions, "positions", ("F", "V", 3))
        if not positions.size:
            raise ValueError(f"track '{self.name}': positions {positions.shape} are empty")
        self._finite(positions, "positions", "vertex")
        object.__setattr__(self, "positions", positions)
        try:
            faces = TriMesh(positions[0], self.faces).faces
        except ValueError as problem:
            raise ValueError(f"track '{self.name}': {problem}") from None
        object.__setattr__(self, "faces", faces)
        self._check_rest()
        self._check_drawn()

    @staticmethod
    def still(
        name: str, vertices: ArrayLike, faces: ArrayLike, frames: int, *, body: bool = True
    ) -> Track:
        """A surface (V,3) that does not move in any of the frames; it takes the memory of one."""
        one = np.asarray(vertices, dtype=np.float64)
        shown = np.broadcast_to(one, (frames, *one.shape))
        return Track(name, shown, np.asarray(faces), body=body)

    @cached_property
    def mesh(self) -> TriMesh:
        """The first frame."""
        return TriMesh(self.positions[0], self.faces)

    @cached_property
    def moves(self) -> bool:
        """Whether any vertex is elsewhere in a later frame."""
        if self.positions.strides[0] == 0:
            return False
        return bool(np.any(self.positions != self.positions[:1]))

    @cached_property
    def orientable(self) -> bool:
        """Whether the faces agree on a front: not so on a Moebius band."""
        try:
            self.mesh.hinges  # noqa: B018  (refuses a seam)
        except ValueError:
            return False
        return True

    def _check_rest(self) -> None:
        count = self.positions.shape[1]
        if self.rest is not None:
            rest = self._real(self.rest, "rest", (count, 3))
            self._finite(rest, "rest", "vertex")
            object.__setattr__(self, "rest", rest)
        if self.rest_angles is not None:
            hinges = len(self.mesh.hinges)
            angles = self._real(self.rest_angles, "rest_angles", (hinges,))
            self._finite(angles, "rest_angles", "hinge")
            object.__setattr__(self, "rest_angles", angles)

    def _check_drawn(self) -> None:
        frames, count = self.positions.shape[:2]
        if self.lines is not None:
            lines = self._real(self.lines, "lines", (frames, "L", 2, 3))
            self._finite(lines, "lines", "line")
            object.__setattr__(self, "lines", lines)
        if self.contact is not None:
            contact = np.asarray(self.contact)
            if contact.dtype != np.bool_:
                raise ValueError(
                    f"track '{self.name}': contact must be true or false, got {contact.dtype}"
                )
            self._check_shape(contact, "contact", (frames, count))
            object.__setattr__(self, "contact", contact)

    def _real(self, values: ArrayLike, what: str, shape: tuple[int | str, ...]) -> FloatArray:
        try:
            array = np.asarray(values, dtype=np.float64)
        except (TypeError, ValueError) as problem:
            raise ValueError(f"track '{self.name}': {what}: {problem}") from None
        self._check_shape(array, what, shape)
        return array

    def _check_shape(self, array: AnyArray, what: str, shape: tuple[int | str, ...]) -> None:
        fits = array.ndim == len(shape) and all(
            isinstance(want, str) or want == have for want, have in zip(shape, array.shape)
        )
        if not fits:
            wanted = ", ".join(map(str, shape)) + ("," if len(shape) == 1 else "")
            raise ValueError(
                f"track '{self.name}': {what} must have shape ({wanted}), got {array.shape}"
            )

    def _finite(self, array: FloatArray, what: str, item: str) -> None:
        # One number is enough to know, and needs no second array of the same size.
        if math.isfinite(float(array.min(initial=0.0)) + float(array.max(initial=0.0))):
            return
        where = np.argwhere(~np.isfinite(array))[0]
        timed = f"frame {where[0]}, " if what in ("positions", "lines") else ""
        place = where[1] if timed else where[0]
        raise ValueError(f"track '{self.name}': {what} not finite at {timed}{item} {place}")


@dataclass(frozen=True, eq=False)
class Animation:
    """Surfaces that move together.

    times     (F,) s, increasing
    tracks    at least one, all with F frames and names of their own
    up        (3,) the scene's up axis
    title     heading of the player
    captions  one text a frame, or none
    series    curves (F,) for the player by name: energies, residuals, iterations.  What is not
              finite is a gap

    ValueError names the track, frame or curve at fault.
    """

    times: FloatArray
    tracks: tuple[Track, ...]
    up: tuple[float, float, float] = (0.0, 1.0, 0.0)
    title: str = "Animation"
    captions: tuple[str, ...] = ()
    series: Mapping[str, FloatArray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        times = np.asarray(self.times, dtype=np.float64)
        if times.ndim != 1 or not len(times):
            raise ValueError(f"times must be (F,) with at least one frame, got {times.shape}")
        late = np.flatnonzero(~(np.isfinite(times) & (np.diff(times, prepend=-np.inf) > 0)))
        if len(late):
            raise ValueError(f"times must increase: frame {late[0]} is at {times[late[0]]} s")
        _, axis, _ = directions(self.up)
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "up", tuple(float(value) for value in axis))
        object.__setattr__(self, "tracks", tuple(self.tracks))
        object.__setattr__(self, "captions", tuple(self.captions))
        self._check_tracks()
        self._check_words()

    @property
    def frames(self) -> int:
        return len(self.times)

    @property
    def fps(self) -> float:
        """Frames per second: that of most frames; 24 for a single one."""
        if self.frames == 1:
            return 24.0
        rate = 1.0 / float(np.median(np.diff(self.times)))
        return float(round(rate)) if abs(rate - round(rate)) < _EVEN * rate else rate

    @property
    def even(self) -> bool:
        """Whether all frames are the same time apart."""
        steps = np.diff(self.times) * self.fps
        return bool(np.all(np.abs(steps - 1.0) < _EVEN * max(1.0, self.times[-1] * self.fps)))

    def cloud(self) -> FloatArray:
        """Two corners (2,3) of the box around all that moves, or around all if nothing does."""
        moving = [track for track in self.tracks if not track.body] or list(self.tracks)
        low = np.min([track.positions.min(axis=(0, 1)) for track in moving], axis=0)
        high = np.max([track.positions.max(axis=(0, 1)) for track in moving], axis=0)
        return np.stack([low, high])

    def _check_tracks(self) -> None:
        if not self.tracks:
            raise ValueError("an animation needs at least one track")
        for number, track in enumerate(self.tracks):
            if len(track.positions) != self.frames:
                raise ValueError(
                    f"track '{track.name}' has {len(track.positions)} frames, times has "
                    f"{self.frames}"
                )
            if track.name in {other.name for other in self.tracks[:number]}:
                raise ValueError(f"two tracks are named '{track.name}'")

    def _check_words(self) -> None:
        if self.captions and len(self.captions) != self.frames:
            raise ValueError(
                f"captions: one a frame or none, got {len(self.captions)} for {self.frames} frames"
            )
        curves: dict[str, Any] = {}
        for name, values in self.series.items():
            curves[name] = np.asarray(values, dtype=np.float64)
            if curves[name].shape != (self.frames,):
                raise ValueError(
                    f"series '{name}' must have shape ({self.frames},), got {curves[name].shape}"
                )
        object.__setattr__(self, "series", curves)
