"""How obstacles move: rigid keyframes and sequences of meshes.

A motion is told to `casashell.simulate` for an obstacle as the result knows it, its shape at time 0.
It is made into a `Body`, which tells at any time how far points are from the surface, and where
points that ride on the surface are carried from one time to another: contact velocities come from
there, so that they agree with the positions at both ends of a step.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol, runtime_checkable

import numpy as np

from casashell.contact.mesh_obstacle import MeshObstacle
from casashell.contact.obstacles import Obstacle
from casashell.contact.validation import points3
from casashell.dynamics.bodies import Body, DeformingBody, RigidBody
from casashell.typing import AnyArray, ArrayLike, FloatArray, IntArray

#: How far frame 0 of a sequence may be from the obstacle, in the size of its bounding box.
_SAME = 1e-3


@runtime_checkable
class Motion(Protocol):
    """What `casashell.simulate` asks of a motion; write your own by offering this method.

    bind  the obstacle of the scene, number ``number``, as a `Body` that moves for ``seconds``.
          Raises ValueError when the motion does not suit the obstacle or ends too early
    """

    def bind(self, obstacle: Obstacle, number: int, seconds: float) -> Body: ...


@dataclass(frozen=True, eq=False)
class RigidMotion:
    """Rigid keyframes: ``x -> center + R(t) (x - center) + T(t)`` for every point of the obstacle.

    times        (K,) s, strictly increasing
    translation  (K,3) m; none: no translation
    rotation     (K,3) rad, rotation vectors (axis times angle); angles beyond pi are turns.  None: no
                 rotation
    center       (3,) m, what the rotation leaves in place

    Between keyframes each component follows a monotone cubic (PCHIP: smooth, no overshoot); before the
    first and after the last it rests.  Raises ValueError naming the keyframe that is not finite or
    not later than the one before, and arrays of the wrong length.
    """

    times: FloatArray
    translation: ArrayLike | None = None
    rotation: ArrayLike | None = None
    center: ArrayLike = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        times = _checked_times(self.times, "RigidMotion", "keyframe")
        object.__setattr__(self, "times", times)
        for name, unit in (("translation", "m"), ("rotation", "rad")):
            value = getattr(self, name)
            rows = np.zeros((len(times), 3)) if value is None else _rows(value, name)
            if len(rows) != len(times):
                raise ValueError(
                    f"RigidMotion {name} has {len(rows)} keyframes and times has {len(times)}: "
                    f"give one row of three numbers [{unit}] a time"
                )
            object.__setattr__(self, name, rows)
        center = np.asarray(self.center, dtype=np.float64)
        if center.shape != (3,) or not np.isfinite(center).all():
            raise ValueError(
                f"RigidMotion center must be three finite numbers, got {self.center!r}"
            )
        object.__setattr__(self, "center", center)

    @cached_property
    def _curve(self) -> Any:
        from scipy.interpolate import PchipInterpolator

        return PchipInterpolator(self.times, self._keys)

    @property
    def _keys(self) -> FloatArray:
        return np.hstack([np.asarray(self.translation), np.asarray(self.rotation)])

    def at(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Rotation (3,3) and shift (3,) [m] of ``x -> R x + s`` at ``time`` [s]."""
        from scipy.spatial.transform import Rotation

        if len(self.times) == 1:
            now = self._keys[0]
        else:
            now = self._curve(np.clip(time, self.times[0], self.times[-1]))
        turn = np.eye(3) if not now[3:].any() else Rotation.from_rotvec(now[3:]).as_matrix()
        center = np.asarray(self.center)
        return np.asarray(turn), np.asarray(center - turn @ center + now[:3])

    def bind(self, obstacle: Obstacle, number: int, seconds: float) -> Body:
        """The obstacle carried along; any kind will do."""
        return RigidBody(obstacle, number, self.at)


@dataclass(frozen=True, eq=False)
class MeshSequence:
    """A mesh obstacle given frame by frame, with the faces it has in the scene.

    vertices  (K,V,3) m, frame 0 as in the scene
    times     (K,) s, strictly increasing from 0 or before; they must reach the end of the simulation
    faces     (T,3) of the sequence, only to be compared with those of the obstacle

    Vertices move in straight lines between frames.  Raises ValueError naming the frame and vertex that
    are not finite, times that do not increase, and arrays of the wrong length or topology.
    """

    vertices: FloatArray
    times: FloatArray
    faces: IntArray | None = None

    def __post_init__(self) -> None:
        frames = np.ascontiguousarray(self.vertices, dtype=np.float64)
        if frames.ndim != 3 or frames.shape[2] != 3 or 0 in frames.shape:
            raise ValueError(
                f"MeshSequence vertices must have shape (frames, vertices, 3), got {frames.shape}; "
                "every frame needs the same vertices"
            )
        bad = np.argwhere(~np.isfinite(frames).all(axis=2))
        if len(bad):
            raise ValueError(
                f"MeshSequence frame {int(bad[0, 0])}: vertex {int(bad[0, 1])} is not finite; "
                "repair the file or leave the frame out"
            )
        times = _checked_times(self.times, "MeshSequence", "frame")
        if len(times) != len(frames):
            raise ValueError(
                f"MeshSequence has {len(frames)} frames and {len(times)} times: give one time a frame"
            )
        object.__setattr__(self, "vertices", frames)
        object.__setattr__(self, "times", times)

    @staticmethod
    def at_rate(vertices: ArrayLike, fps: float, faces: IntArray | None = None) -> MeshSequence:
        """Frames (K,V,3) m that follow each other at ``fps`` a second from time 0."""
        if not (np.isfinite(fps) and fps > 0.0):
            raise ValueError(f"fps of a mesh sequence must be a positive number, got {fps}")
        frames = np.asarray(vertices, dtype=np.float64)
        return MeshSequence(frames, np.arange(len(frames)) / fps, faces)

    def at(self, time: float) -> FloatArray:
        """Vertices (V,3) m at ``time`` [s]."""
        k = int(np.searchsorted(self.times, time, side="right")) - 1
        if k < 0:
            return np.asarray(self.vertices[0])
        if k >= len(self.times) - 1:
            return np.asarray(self.vertices[-1])
        share = (time - self.times[k]) / (self.times[k + 1] - self.times[k])
        here, there = self.vertices[k], self.vertices[k + 1]
        return np.asarray(here + share * (there - here))

    def bind(self, obstacle: Obstacle, number: int, seconds: float) -> Body:
        """The obstacle deformed along; ValueError unless it is a mesh with these vertices."""
        label = obstacle.name or f"obstacle {number}"
        if not isinstance(obstacle, MeshObstacle):
            raise ValueError(
                f"a mesh sequence moves a mesh, {label} is a {type(obstacle).__name__}; "
                "use RigidMotion for it"
            )
        mesh = obstacle.mesh
        points, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
        if self.vertices.shape[1] != len(points):
            raise ValueError(
                f"frame 0 of the mesh sequence has {self.vertices.shape[1]} vertices, {label} has "
                f"{len(points)}: every frame needs the topology of the obstacle"
            )
        if self.faces is not None and not np.array_equal(self.faces, faces):
            raise ValueError(
                f"the mesh sequence has other faces than {label}: same topology needed"
            )
        if self.times[0] > 0.0 or self.times[-1] < seconds * (1.0 - 1e-9):
            raise ValueError(
                f"the mesh sequence of {label} covers {self.times[0]:g} .. {self.times[-1]:g} s, the "
                f"simulation 0 .. {seconds:g} s: give more frames or simulate less"
            )
        away = np.linalg.norm(self.at(0.0) - points, axis=1)
        size = float(np.linalg.norm(np.ptp(points, axis=0)))
        if away.max() > _SAME * size:
            raise ValueError(
                f"at time 0 vertex {int(np.argmax(away))} of the mesh sequence is {away.max():.3g} m "
                f"from where {label} has it: the sequence must start from the scene (units, axes?)"
            )
        return DeformingBody(obstacle, number, self.at)


def _checked_times(times: ArrayLike, owner: str, frame: str) -> FloatArray:
    made = np.array(times, dtype=np.float64)
    if made.ndim != 1 or made.size == 0:
        raise ValueError(f"{owner} times must be a list of seconds, got shape {made.shape}")
    bad = np.flatnonzero(~np.isfinite(made))
    if bad.size:
        raise ValueError(f"{owner}: time of {frame} {int(bad[0])} is not finite")
    back = np.flatnonzero(np.diff(made) <= 0.0)
    if back.size:
        k = int(back[0]) + 1
        raise ValueError(
            f"{owner}: {frame} {k} is at {made[k]:g} s, not after {frame} {k - 1} at "
            f"{made[k - 1]:g} s; sort them and drop doubles"
        )
    return made


def _rows(value: ArrayLike, name: str) -> AnyArray:
    rows = np.asarray(value, dtype=np.float64)
    return points3(rows[None] if rows.shape == (3,) else rows, f"RigidMotion {name}", "keyframe")
