"""How good a natural shape is as a mesh, and how far it went from the target."""

from __future__ import annotations

import numpy as np

from casashell.mesh import TriMesh
from casashell.result import Quality
from casashell.self_intersections import self_intersections
from casashell.strain import angle_change, relative_stretch
from casashell.typing import FloatArray, IntArray


def corner_angles(points: FloatArray, faces: IntArray) -> FloatArray:
    """Angles of every triangle (F,3) [rad]."""
    corners = points[faces]
    one = np.roll(corners, -1, axis=1) - corners
    two = np.roll(corners, 1, axis=1) - corners
    across = np.linalg.norm(np.cross(one, two), axis=2)
    return np.asarray(np.arctan2(across, (one * two).sum(axis=2)))


def rigid_fit(source: FloatArray, goal: FloatArray) -> FloatArray:
    """``source`` (N,3) moved rigidly onto ``goal`` in the least-squares sense."""
    a, b = source.mean(axis=0), goal.mean(axis=0)
    u, _, vh = np.linalg.svd((source - a).T @ (goal - b))
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vh)) or 1.0])
    return np.asarray((source - a) @ u @ flip @ vh + b)


def assess(target: TriMesh, rest: FloatArray, softest_factor: float | None = None) -> Quality:
    """Quality of the natural shape ``rest`` (V,3); see `Quality`.

    A face counts as turned over when, after the best rigid fit, its normal points away from the
    target's.
    """
    shape = target.moved(rest)
    stretch = relative_stretch(target.vertices, rest, target.edges)
    fold = angle_change(target.vertices, rest, target.hinges)
    fitted = target.moved(rigid_fit(rest, target.vertices))
    turned = (fitted.face_normals * target.face_normals).sum(axis=1) < 0.0
    return Quality(
        max_stretch=float(np.abs(stretch).max(initial=0.0)),
        max_rest_fold=float(np.abs(fold).max(initial=0.0)),
        min_rest_angle=float(corner_angles(rest, target.faces).min()),
        flipped_faces=int(turned.sum()),
        rest_self_intersections=len(self_intersections(shape.vertices, shape.faces)),
        softest_factor=softest_factor,
    )
