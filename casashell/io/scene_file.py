"""Writes a result as a scene that can be solved again or simulated: scene.toml and its meshes."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from casashell.io.obstacle_tables import in_units, write_obstacles
from casashell.io.polygons import triangulated
from casashell.io.toml_tables import Value, write_table
from casashell.mesh import TriMesh
from casashell.result import Result
from casashell.typing import AnyArray

_NAMES: Final = {1.0: "m", 0.1: "dm", 0.01: "cm", 0.001: "mm"}
_AXES: Final = "xyz"
#: Keys of [material] and the arrays they stand for.
_MATERIAL: Final = {
    "density": "density",
    "stretch": "stretch",
    "bend": "bend",
    "friction": "vertex_friction",
}

#: The target in the input's own unit, which scene.toml calls the shell.
TARGET_FILE: Final = "target.obj"


def write_scene(
    result: Result, folder: Path, *, unit: float, name: str = "", arrays: str = "result.npz"
) -> None:
    """Write scene.toml, target.obj and obstacle-N.obj into ``folder``.

    unit    metres per unit of the files
    name    what the scene is called
    arrays  the npz file in ``folder`` that holds per-element material values under their names
    """
    from casashell.io.meshes import write_mesh

    write_mesh(folder / TARGET_FILE, _rereadable(result.target), unit=unit)
    gravity = np.asarray(result.material.get("gravity", np.zeros(3)), dtype=np.float64)
    up = up_axis(gravity)
    top: dict[str, Value] = {"name": name} if name else {}
    top |= {"method": result.method, "gravity": _gravity(gravity, up)}
    if result.metric is not None:
        top["natural"] = "metric"
    if result.contact_tolerance is not None:
        top["tolerance"] = in_units(result.contact_tolerance, unit)
    if len(result.pinned):
        top["pinned"] = result.pinned.tolist()
    shell: dict[str, Value] = {"file": TARGET_FILE, "unit": _NAMES.get(unit, unit), "up": up or "y"}
    tables = [
        "# The scene of this result, lengths in its own unit: `casashell invert scene.toml`.\n",
        write_table("", top),
        write_table("[shell]", shell),
    ]
    material = {
        key: _material(result.material[array], f"{arrays}:{array}")
        for key, array in _MATERIAL.items()
        if array in result.material
    }
    if material:
        tables.append(write_table("[material]", material))
    tables += [
        write_table("[[obstacle]]", table)
        for table in write_obstacles(result.obstacles, folder, unit)
    ]
    (folder / "scene.toml").write_text("\n".join(tables), encoding="utf-8")


def _rereadable(mesh: TriMesh) -> TriMesh:
    """The mesh with its polygons if a reader would cut them into the same triangles, else without.

    Values per edge and hinge belong to one triangulation.
    """
    if not mesh.polygons or np.array_equal(triangulated(mesh.vertices, mesh.polygons), mesh.faces):
        return mesh
    return TriMesh(mesh.vertices, mesh.faces)


def up_axis(gravity: AnyArray) -> str:
    """The axis gravity points against; empty when there is none or it is not along an axis."""
    along = np.flatnonzero(gravity)
    if len(along) != 1 or gravity[along[0]] > 0.0:
        return ""
    return _AXES[int(along[0])]


def _gravity(gravity: AnyArray, up: str) -> Value:
    if up:
        return float(-gravity[_AXES.index(up)])
    return [float(component) for component in gravity] if np.any(gravity) else 0.0


def _material(values: AnyArray, reference: str) -> Value:
    return float(values) if np.ndim(values) == 0 else reference
