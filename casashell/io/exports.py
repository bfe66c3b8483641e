"""A result in the terms of simulators: Newton, Vellum (Houdini), Blender, or plain arrays.

All of them store rest lengths and angles per element; how they order and sign them is written down with
each exporter.  Positions are in metres, in the axes of the input.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np

from casashell.io.exports_text import BLENDER_SCRIPT, NEWTON_SCRIPT, VELLUM_SCRIPT
from casashell.mesh import TriMesh
from casashell.metric import Metric, MetricIndex
from casashell.result import Result
from casashell.strain import dihedral_angles
from casashell.typing import AnyArray, FloatArray, IntArray

Writer: TypeAlias = Callable[[Result, Metric, Path], tuple[str, ...]]


def export(result: Result, kind: str, folder: Path) -> tuple[str, ...]:
    """Write the files of one kind into ``folder`` and return their names.

    Raises ValueError for an unknown kind, a result without a natural shape, and one that has no
    natural mesh where the format needs one; OSError for what the file system refuses.
    """
    if kind not in EXPORTS:
        raise ValueError(f"no export '{kind}'; available: {', '.join(EXPORTS)}")
    metric = metric_of(result)
    if kind in _NEED_A_MESH and not metric.embedded:
        raise ValueError(
            f"{kind} takes its rest lengths from a mesh, and no mesh has the natural lengths and "
            "angles of this result: use newton, vellum or npz, or a stiffer material"
        )
    folder.mkdir(parents=True, exist_ok=True)
    return EXPORTS[kind](result, metric, folder)


def metric_of(result: Result) -> Metric:
    """The natural metric of a result; from its natural mesh when none was asked for.

    Raises ValueError when the natural shape is not finite.
    """
    if result.metric is not None:
        return result.metric
    if not np.isfinite(result.rest).all():
        raise ValueError("this result has no natural shape: the solve broke down")
    return Metric.of(result.target, result.rest)


def newton_order(hinges: IntArray) -> IntArray:
    """Hinges (H,4) as rows (o0, o1, v0, v1) of Newton's ``edge_indices``.

    The triangles of such a row are (o0, v0, v1) and (o1, v1, v0); its angle has the same sign as
    here: positive where the faces fold away from the side the normals point to.
    """
    return np.ascontiguousarray(hinges[:, [2, 3, 0, 1]])


def _newton(result: Result, metric: Metric, folder: Path) -> tuple[str, ...]:
    """Arrays for `ModelBuilder.add_cloth_mesh` models, and a loader that matches them by vertices.

    Newton's edges are bending elements: ``edge_rest_length`` is the length of the shared edge.  Its
    membrane is made of triangles with a rest pose each (``tri_poses``), a 2 x 2 matrix per triangle:
    the inverse of the rest edges in the plane of the triangle, first edge along x.
    """
    lengths = metric.rest_length[MetricIndex(result.target).edges(metric.hinges[:, :2])]
    poses = triangle_poses(result.target, metric)
    arrays = {
        "pose": result.pose,
        "tri_indices": result.target.faces,
        "tri_poses": poses,
        "tri_areas": metric.rest_area,
        "edge_indices": newton_order(metric.hinges),
        "edge_rest_angle": metric.rest_angle,
        "edge_rest_length": lengths,
        **_springs(metric),
    }
    _save(folder / "newton.npz", arrays)
    (folder / "load_newton.py").write_text(NEWTON_SCRIPT, encoding="utf-8")
    return "newton.npz", "load_newton.py"


def triangle_poses(mesh: TriMesh, metric: Metric) -> FloatArray:
    """Inverse rest edge matrices (F,2,2) [1/m]: columns of the matrix are the edges from corner 0.

    The first edge lies along x, the second above it.
    """
    across, second, first = metric.rest_length[MetricIndex(mesh).sides].T
    along = (first**2 + second**2 - across**2) / (2.0 * first)
    height = 2.0 * metric.rest_area / first
    made = np.zeros((len(first), 2, 2))
    made[:, 0, 0], made[:, 0, 1], made[:, 1, 1] = first, along, height
    return np.asarray(np.linalg.inv(made))


def _springs(metric: Metric) -> dict[str, AnyArray]:
    """Every edge as a spring, in the terms of Newton's `add_spring`."""
    return {"spring_indices": metric.edges, "spring_rest_length": metric.rest_length}


def _vellum(result: Result, metric: Metric, folder: Path) -> tuple[str, ...]:
    """Rest values of Vellum's stretch and bend constraints as tables, and a script that sets them.

    Vellum measures bending in degrees and orders constraints its own way: rows are found by their
    points.  Bend rows say how far the rest angle is from the angle of the pose.
    """
    with (folder / "vellum_stretch.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(("point0", "point1", "restlength"))
        for (a, b), length in zip(metric.edges.tolist(), metric.rest_length.tolist(), strict=True):
            writer.writerow((a, b, repr(length)))
    now = np.degrees(dihedral_angles(result.pose, metric.hinges))
    rest = np.degrees(metric.rest_angle)
    with (folder / "vellum_bend.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(("edge0", "edge1", "side0", "side1", "poseangle", "restangle"))
        for hinge, pose_angle, rest_angle in zip(
            metric.hinges.tolist(), now.tolist(), rest.tolist(), strict=True
        ):
            writer.writerow((*hinge, repr(pose_angle), repr(rest_angle)))
    _write_pose(result, folder)
    (folder / "set_vellum.py").write_text(VELLUM_SCRIPT, encoding="utf-8")
    return "pose.obj", "set_vellum.py", "vellum_bend.csv", "vellum_stretch.csv"


def _blender(result: Result, metric: Metric, folder: Path) -> tuple[str, ...]:
    """Pose and natural mesh with the same vertices, and a script that makes the rest shape key."""
    from casashell.io.meshes import write_mesh

    _write_pose(result, folder)
    write_mesh(folder / "rest.obj", result.target, result.rest)
    (folder / "load_blender.py").write_text(BLENDER_SCRIPT, encoding="utf-8")
    return "load_blender.py", "pose.obj", "rest.obj"


def _npz(result: Result, metric: Metric, folder: Path) -> tuple[str, ...]:
    """Everything as plain arrays in SI."""
    arrays = {
        "pose": result.pose,
        "faces": result.target.faces,
        "edges": metric.edges,
        "rest_length": metric.rest_length,
        "hinges": metric.hinges,
        "rest_angle": metric.rest_angle,
        "rest_area": metric.rest_area,
    }
    if metric.embedded:
        arrays["rest"] = result.rest
    _save(folder / "rest.npz", arrays)
    return ("rest.npz",)


def _write_pose(result: Result, folder: Path) -> None:
    from casashell.io.meshes import write_mesh

    write_mesh(folder / "pose.obj", result.target, result.pose)


def _save(path: Path, arrays: Mapping[str, AnyArray]) -> None:
    plain: dict[str, Any] = dict(arrays)
    np.savez(path, **plain)


_NEED_A_MESH: Final = ("blender",)
#: Writers by the name of the simulator.
EXPORTS: Final[Mapping[str, Writer]] = {
    "newton": _newton,
    "vellum": _vellum,
    "blender": _blender,
    "npz": _npz,
}
