"""Scenes: what the command line and scene files describe, made into a `Problem`.

options or scene.toml  ->  SceneSpec (paths and numbers as given)
                       ->  Scene (meshes and arrays in SI)
                       ->  Problem
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from casashell.app.values import (
    METHODS,
    UP_VECTORS,
    ArrayReference,
    Gravity,
    MaterialValue,
    Pins,
    read_pins,
)
from casashell.contact.obstacles import Obstacle
from casashell.io.obstacle_tables import read_obstacle
from casashell.mesh import TriMesh
from casashell.mesh_checks import validate
from casashell.problem import Problem
from casashell.solving import StepTwoMethod
from casashell.typing import FloatArray, IntArray
from formulations import discrete_shell

#: Shells beyond these sizes [m] are taken for mistakes.
SMALLEST_SIZE, LARGEST_SIZE = 1e-9, 1e9


@dataclass(frozen=True, eq=False)
class Material:
    """Numbers, or one value per element.

    density  kg/m2, per face;  stretch  N, per edge;  bend  J, per hinge
    friction  Coulomb coefficient, per vertex; None: that of the obstacles
    """

    density: float | FloatArray = 0.2
    stretch: float | FloatArray = 20.0
    bend: float | FloatArray = 1e-3
    friction: float | FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Scene:
    """A shell, what it rests on and what it is made of; SI throughout.

    target     the designed pose, m, in the axes of the input
    gravity    (3,) m/s2
    pinned     vertex ids
    tolerance  contact tolerance [m]; None: 0.5 % of the target's bounding box diagonal
    prefer     (V,3) m, a natural shape to stay near; None: any
    up         up axis of the input
    unit       metres per unit of the input, for files written from this scene
    vertex_map (V_input,) where repair put each vertex of the file, -1 if dropped; None: unchanged
    remarks    what was done to the input on the way
    """

    name: str
    target: TriMesh
    obstacles: tuple[Obstacle, ...] = ()
    material: Material = field(default_factory=Material)
    gravity: tuple[float, float, float] = (0.0, -9.81, 0.0)
    pinned: tuple[int, ...] = ()
    tolerance: float | None = None
    method: str = METHODS[0]
    step2: StepTwoMethod = "ipopt"
    natural: str = "mesh"
    prefer: FloatArray | None = None
    up: str = "y"
    unit: float = 1.0
    vertex_map: IntArray | None = None
    remarks: tuple[str, ...] = ()

    @cached_property
    def problem(self) -> Problem:
        """What `casashell.solve` takes.

        Raises MeshError for a mesh that cannot be simulated and ValueError for pins, material
        values and tolerances that do not fit, naming vertex, element or parameter.
        """
        try:
            energies = discrete_shell(
                self.target,
                density=self.material.density,
                stretch=self.material.stretch,
                bend=self.material.bend,
                gravity=self.gravity,
            )
        except ValueError:
            validate(self.target)  # a broken surface has no hinges: say what is wrong with it all
            raise
        return Problem(
            self.target,
            energies,
            self.obstacles,
            self.pinned,
            self.tolerance,
            self.material.friction,
        )

    @property
    def mass(self) -> float:
        """Mass of the target [kg]."""
        return float(np.sum(np.asarray(self.material.density) * self.target.face_areas))

    @property
    def weight(self) -> float:
        """Weight of the target [N]."""
        return self.mass * math.hypot(*self.gravity)

    @property
    def up_vector(self) -> tuple[float, float, float]:
        """Against gravity where there is some, else the up axis."""
        if any(self.gravity):
            x, y, z = self.gravity
            return (-x, -y, -z)
        return UP_VECTORS[self.up]


@dataclass(frozen=True)
class SceneSpec:
    """A scene as given, nothing read yet: paths, lengths in the unit of the input.

    obstacles  (where it was given, table) pairs; the tables are those of a scene file, with
               paths relative to the folder beside them
    friction   overrides the friction of every obstacle
    """

    shell: Path
    name: str = ""
    unit: float = 1.0
    up: str = "y"
    gravity: Gravity = 9.81
    density: MaterialValue = 0.2
    stretch: MaterialValue = 20.0
    bend: MaterialValue = 1e-3
    vertex_friction: MaterialValue | None = None
    obstacles: tuple[ObstacleSource, ...] = ()
    friction: float | None = None
    pinned: Pins = ()
    tolerance: float | None = None
    method: str = METHODS[0]
    step2: StepTwoMethod = "ipopt"
    natural: str = "mesh"
    prefer: Path | None = None
    file: Path | None = None

    @property
    def inputs(self) -> tuple[Path, ...]:
        """Every file the scene reads."""
        material = (self.density, self.stretch, self.bend, self.vertex_friction)
        files = [
            self.shell,
            *(value.path for value in material if isinstance(value, ArrayReference)),
        ]
        files += [source.file for source in self.obstacles if source.file is not None]
        files += [path for path in (self.file, self.pinned, self.prefer) if isinstance(path, Path)]
        return tuple(files)

    def load(self, *, repair: bool = False) -> Scene:
        """Read the files and convert to SI; ``repair`` mends the shell first.

        Raises ValueError naming file, table or parameter, OSError for files that cannot be read.
        """
        from casashell.io.meshes import read_mesh_file

        file = read_mesh_file(self.shell, unit=self.unit)
        target, remarks = file.mesh, file.notes
        _check_size(target, self.shell)
        pinned, vertex_map = read_pins(self.pinned), None
        if repair:
            target, vertex_map, done = _mended(target)
            remarks += done
            if vertex_map is not None:
                pinned = _renumbered(pinned, vertex_map)
        return Scene(
            name=self.name or self.shell.stem,
            target=target,
            obstacles=tuple(source.read(self.unit, self.friction) for source in self.obstacles),
            material=Material(
                density=_value(self.density),
                stretch=_value(self.stretch),
                bend=_value(self.bend),
                friction=None if self.vertex_friction is None else _value(self.vertex_friction),
            ),
            gravity=self.gravity_vector,
            pinned=pinned,
            tolerance=None if self.tolerance is None else self.tolerance * self.unit,
            method=self.method,
            step2=self.step2,
            natural=self.natural,
            prefer=None
            if self.prefer is None
            else self._preferred(self.prefer, file.mesh, vertex_map),
            up=self.up,
            unit=self.unit,
            vertex_map=vertex_map,
            remarks=remarks,
        )

    def _preferred(self, path: Path, shell: TriMesh, vertex_map: IntArray | None) -> FloatArray:
        """Vertices of the preferred shape (V,3) m, dropped and merged as those of the shell were."""
        from casashell.io.meshes import read_mesh_file

        found = read_mesh_file(path, unit=self.unit).mesh
        same = (
            found.polygons == shell.polygons  # the diagonals of its quads follow its own shape
            if shell.polygons
            else np.array_equal(found.faces, shell.faces)
        )
        if not same:
            raise ValueError(
                f"{path}: the preferred shape must have the faces of {self.shell} in the same order; "
                f"it has {len(found.vertices)} vertices and {len(found.faces)} triangles, the shell "
                f"{len(shell.vertices)} and {len(shell.faces)}"
            )
        if vertex_map is None:
            return found.vertices
        kept = np.flatnonzero(vertex_map >= 0)
        places = np.empty((int(vertex_map.max()) + 1, 3))
        places[vertex_map[kept]] = found.vertices[kept]
        return places

    @property
    def gravity_vector(self) -> tuple[float, float, float]:
        """Gravity in the axes of the input [m/s2]."""
        if isinstance(self.gravity, tuple):
            return self.gravity
        x, y, z = (0.0 - self.gravity * component for component in UP_VECTORS[self.up])
        return (x, y, z)


@dataclass(frozen=True)
class ObstacleSource:
    """An obstacle as given: its table, what to call it in messages, where its paths start."""

    table: Mapping[str, Any]
    where: str
    folder: Path = Path()

    @property
    def file(self) -> Path | None:
        """The mesh file, if there is one."""
        file = self.table.get("file") if isinstance(self.table, Mapping) else None
        return self.folder / file if isinstance(file, str) else None

    def read(self, unit: float, friction: float | None) -> Obstacle:
        """The obstacle in m."""
        return read_obstacle(self.table, self.where, self.folder, unit, friction)


def _check_size(mesh: TriMesh, path: Path) -> None:
    """Beyond these sizes squares and cubes of lengths leave the range of numbers."""
    size = float(np.ptp(mesh.vertices, axis=0).max())
    if not SMALLEST_SIZE < size < LARGEST_SIZE:
        raise ValueError(f"{path}: the shell is {size:.3g} m across; check the file and its unit")


def _value(given: MaterialValue) -> float | FloatArray:
    return given.read() if isinstance(given, ArrayReference) else given


def _mended(mesh: TriMesh) -> tuple[TriMesh, IntArray | None, tuple[str, ...]]:
    """Repaired mesh, vertex map (None if no vertex moved to another number), what was done."""
    from casashell.repair import repaired

    repair = repaired(mesh)
    unchanged = np.array_equal(repair.vertex_map, np.arange(len(mesh.vertices)))
    remarks = repair.report or ("nothing to repair",)
    return repair.mesh, None if unchanged else repair.vertex_map, tuple(remarks)


def _renumbered(pinned: Sequence[int], vertex_map: IntArray) -> tuple[int, ...]:
    """Pins of the input as vertices of the repaired mesh; dropped ones name themselves."""
    for pin in pinned:
        if not 0 <= pin < len(vertex_map):
            raise ValueError(
                f"pinned vertex {pin} does not exist: ids go from 0 to {len(vertex_map) - 1}"
            )
        if vertex_map[pin] < 0:
            raise ValueError(f"pinned vertex {pin} was dropped by the repair: it is in no face")
    return tuple(int(vertex_map[pin]) for pin in pinned)
