"""Obstacles as ``[[obstacle]]`` tables of a scene file, both ways.

Lengths in the file are in its own unit; angles are rad; keys are the fields of the classes in
`casashell.contact.obstacles`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from casashell.contact.obstacles import (
    Capsule,
    Cone,
    Cylinder,
    MeshObstacle,
    Obstacle,
    Plane,
    Sphere,
)
from casashell.io.toml_tables import Table, Value, did_you_mean
from casashell.mesh import TriMesh

DEFAULT_FRICTION: Final = 0.5


@dataclass(frozen=True)
class _Kind:
    """How one class is written: its fields, by how they scale with the unit."""

    build: Callable[..., Obstacle]
    points: tuple[str, ...] = ()
    directions: tuple[str, ...] = ()
    lengths: tuple[str, ...] = ()
    optional_lengths: tuple[str, ...] = ()
    angles: tuple[str, ...] = ()

    @property
    def keys(self) -> tuple[str, ...]:
        return (
            *self.points,
            *self.directions,
            *self.lengths,
            *self.optional_lengths,
            *self.angles,
        )


KINDS: Final[Mapping[str, _Kind]] = {
    "plane": _Kind(Plane, directions=("normal",), lengths=("offset",)),
    "sphere": _Kind(Sphere, points=("center",), lengths=("radius",)),
    "cylinder": _Kind(
        Cylinder, ("base",), ("axis",), lengths=("radius",), optional_lengths=("length",)
    ),
    "cone": _Kind(Cone, ("apex",), ("axis",), optional_lengths=("length",), angles=("half_angle",)),
    "capsule": _Kind(Capsule, points=("a", "b"), lengths=("radius",)),
}


def read_obstacle(
    values: Any, where: str, folder: Path, unit: float, friction: float | None = None
) -> Obstacle:
    """The obstacle of one table; ``friction`` overrides what the table says.

    Raises ValueError naming the table (and the file of a mesh) for unknown or missing keys and
    for values no obstacle can have, OSError for a mesh that cannot be opened.
    """
    if not isinstance(values, Mapping):
        raise ValueError(f"{where} must be a table; write [[obstacle]]")
    kind = values.get("kind", "mesh" if "file" in values else None)
    if kind is None:
        raise ValueError(f"{where}: kind is missing; known: mesh, {', '.join(KINDS)}")
    common = ("kind", "name", "friction")
    if kind == "mesh":
        table = Table.checked(values, where, (*common, "file", "flip"))
        table.require("file")
        return read_mesh_obstacle(
            folder / table.text("file"),
            unit=unit,
            friction=_friction(table, friction),
            name=table.text("name"),
            flip=table.flag("flip"),
        )
    if not isinstance(kind, str) or kind not in KINDS:
        known = ("mesh", *KINDS)
        raise ValueError(f"{where}: no obstacle of kind {kind!r}; {did_you_mean(str(kind), known)}")
    form = KINDS[kind]
    table = Table.checked(values, where, (*common, *form.keys))
    table.require(*(key for key in form.keys if key not in form.optional_lengths))
    arguments = _arguments(table, form, unit)
    try:
        return form.build(
            **arguments, friction=_friction(table, friction), name=table.text("name", kind)
        )
    except ValueError as problem:
        raise ValueError(f"{where}: {problem}") from None


def _friction(table: Table, override: float | None) -> float:
    given = table.number("friction") if "friction" in table else DEFAULT_FRICTION
    return given if override is None else override


def _arguments(table: Table, form: _Kind, unit: float) -> dict[str, Any]:
    """Constructor arguments of an analytic obstacle, in m."""
    arguments: dict[str, Any] = {key: table.vector(key) for key in form.directions}
    for key in form.points:
        arguments[key] = tuple(unit * component for component in table.vector(key))
    for key in (*form.lengths, *(key for key in form.optional_lengths if key in table)):
        arguments[key] = unit * table.number(key)
    arguments |= {key: table.number(key) for key in form.angles}
    return arguments


def read_mesh_obstacle(
    path: Path, *, unit: float, friction: float, name: str = "", flip: bool = False
) -> MeshObstacle:
    """A mesh file as an obstacle; every ValueError names the file."""
    from casashell.io.meshes import read_mesh

    mesh = read_mesh(path, unit=unit)
    try:
        return MeshObstacle(mesh, friction, name or path.stem, flip)
    except ValueError as problem:
        raise ValueError(f"{path}: {problem}") from None


def write_obstacles(obstacles: Sequence[Any], folder: Path, unit: float) -> list[dict[str, Value]]:
    """Tables of all obstacles; meshes are written into ``folder`` as obstacle-N.obj.

    An obstacle of a class of the user's own becomes ``kind = "custom"``, which no reader accepts.
    """
    from casashell.io.meshes import write_mesh

    tables: list[dict[str, Value]] = []
    for number, obstacle in enumerate(obstacles):
        table: dict[str, Value] = {"kind": kind_of(obstacle), "name": str(obstacle.name)}
        table["friction"] = float(obstacle.friction)
        if isinstance(obstacle, MeshObstacle):
            table["file"] = f"obstacle-{number}.obj"
            if obstacle.flip:
                table["flip"] = True
            mesh = obstacle.mesh
            if not isinstance(mesh, TriMesh):
                mesh = TriMesh(mesh.vertices, mesh.faces)
            write_mesh(folder / f"obstacle-{number}.obj", mesh, unit=unit)
        elif table["kind"] != "custom":
            table |= _fields(obstacle, KINDS[str(table["kind"])], unit)
        tables.append(table)
    return tables


def in_units(length: float, unit: float) -> float:
    """A length [m] in units of ``unit`` metres, without the last digit of the division."""
    return length if unit == 1.0 else float(f"{length / unit:.15g}")


def kind_of(obstacle: Any) -> str:
    """The word for the class of an obstacle: mesh, one of ``KINDS``, or custom."""
    if isinstance(obstacle, MeshObstacle):
        return "mesh"
    return next((kind for kind, form in KINDS.items() if type(obstacle) is form.build), "custom")


def _fields(obstacle: Obstacle, form: _Kind, unit: float) -> dict[str, Value]:
    fields: dict[str, Value] = {}
    for key in form.points:
        fields[key] = [in_units(component, unit) for component in getattr(obstacle, key)]
    for key in form.directions:
        fields[key] = list(getattr(obstacle, key))
    for key in (*form.lengths, *form.optional_lengths):
        value = getattr(obstacle, key)
        if value is not None:
            fields[key] = in_units(value, unit)
    for key in form.angles:
        fields[key] = getattr(obstacle, key)
    return fields
