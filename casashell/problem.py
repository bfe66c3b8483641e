"""What is asked: the natural shape for which a target is a stable frictional equilibrium."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from casashell.contact.detect import Contacts, detect
from casashell.contact.obstacles import Obstacle, checked
from casashell.engine.energy import Energy
from casashell.mesh import TriMesh
from casashell.mesh_checks import Finding, validate
from casashell.typing import ArrayLike, FloatArray, IntArray

#: Contact tolerance as a fraction of the target's bounding box diagonal.
DEFAULT_TOLERANCE = 0.005


@dataclass(frozen=True, eq=False)
class Problem:
    """Find natural positions so that ``target`` is a stable equilibrium.  Holds no solver.

    target             the designed pose, m
    energies           terms of the potential energy, from ``formulations``
    obstacles          what the shell rests on, each with its friction coefficient
    pinned             ids of vertices held by the user: they take any reaction and do not move
    contact_tolerance  a vertex nearer than this to an obstacle touches it [m]; 0.5 % of the
                       target's bounding box diagonal by default

    friction           Coulomb coefficient of the shell's vertices, a number or (V,); by default that
                       of the obstacle a vertex touches

    Raises MeshError for a mesh that cannot be simulated and ValueError for the rest, naming the
    vertex, face or parameter.
    """

    target: TriMesh
    energies: tuple[Energy, ...]
    obstacles: tuple[Obstacle, ...] = ()
    pinned: Sequence[int] | ArrayLike = ()
    contact_tolerance: float | None = None
    friction: ArrayLike | None = None
    findings: tuple[Finding, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if isinstance(self.energies, Energy):
            raise ValueError("energies must be a sequence of Energy; put the single one in a tuple")
        object.__setattr__(self, "energies", tuple(self.energies))
        object.__setattr__(self, "obstacles", checked(self.obstacles))
        object.__setattr__(self, "pinned", self._checked_pins())
        count = len(self.target.vertices)
        if not self.energies:
            raise ValueError("a problem needs at least one energy; see formulations.discrete_shell")
        names = [term.name for term in self.energies]
        if len(set(names)) != len(names):
            raise ValueError(f"energies must have different names, got {', '.join(names)}")
        for term in self.energies:
            term.require_vertices(count)
        object.__setattr__(self, "friction", self._checked_friction())
        tolerance = self.contact_tolerance
        if tolerance is not None and not (np.isfinite(tolerance) and tolerance >= 0.0):
            raise ValueError(f"contact_tolerance must be a length >= 0 m, got {tolerance}")
        object.__setattr__(self, "findings", validate(self.target))

    def _checked_pins(self) -> IntArray:
        pins = np.asarray(self.pinned)
        count = len(self.target.vertices)
        if pins.size == 0:
            return np.empty(0, dtype=np.int64)
        if pins.ndim != 1 or not np.issubdtype(pins.dtype, np.integer):
            raise ValueError("pinned must be a list of vertex ids (whole numbers from 0)")
        wrong = pins[(pins < 0) | (pins >= count)]
        if wrong.size:
            raise ValueError(
                f"pinned vertex {int(wrong[0])} does not exist: ids go from 0 to {count - 1}"
            )
        return np.unique(pins).astype(np.int64)

    def _checked_friction(self) -> FloatArray | None:
        if self.friction is None:
            return None
        count = len(self.target.vertices)
        given = np.array(self.friction, dtype=np.float64)
        if given.ndim and given.shape != (count,):
            raise ValueError(
                f"friction must be a number or one value per vertex, shape ({count},); "
                f"got shape {given.shape}"
            )
        spread = np.array(np.broadcast_to(given, (count,)))
        wrong = np.flatnonzero(~(np.isfinite(spread) & (spread >= 0.0)))
        if wrong.size:
            raise ValueError(
                f"friction of vertex {int(wrong[0])} must be finite and >= 0, got {spread[wrong[0]]:g}"
            )
        return spread

    @property
    def tolerance(self) -> float:
        """Contact tolerance in force [m]."""
        if self.contact_tolerance is not None:
            return float(self.contact_tolerance)
        return DEFAULT_TOLERANCE * float(self.target.bbox_diagonal)

    @cached_property
    def contacts(self) -> Contacts:
        """Unpinned vertices nearer to an obstacle than the tolerance."""
        if not self.obstacles:
            return Contacts.empty()
        pinned = np.asarray(self.pinned)
        found = detect(self.target.vertices, self.obstacles, self.tolerance, pinned)
        if self.friction is None:
            return found
        return replace(found, friction=np.asarray(self.friction)[found.vertices])
