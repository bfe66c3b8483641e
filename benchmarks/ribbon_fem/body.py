"""What both kinds of elements look like to the steppers and to the comparison."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from benchmarks.ribbon_fem.forms import Forms
from benchmarks.ribbon_fem.guiding import guided
from benchmarks.ribbon_fem.patch import Patch
from casashell.engine.assembly import Assembly
from casashell.engine.energy import Energy
from casashell.typing import BoolArray, FloatArray, IntArray


def nodal_mass(patch: Patch, nodes: IntArray, count: int) -> FloatArray:
    """(count,) [kg] a third of every triangle's mass for each of its three ``nodes`` (F,3)."""
    share = np.where(patch.outside, 0.0, patch.density * patch.mesh.face_areas / 3.0)
    total = np.bincount(nodes.ravel(), np.repeat(share, 3), minlength=count)
    return np.asarray(total, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Body:
    """Nodes with masses, energies and links of fixed length.

    rest      (n,3) nodes of the flat sheet [m];  mass (n,) [kg]
    owner     (n,) the hold of a node, -1 where free
    energies  what it costs to deform, gravity left out; the guides of the patch come last
    forms     what keeps lengths, exactly or stiffly
    corners   nodes (n,3) -> corners (F,3,3) of every triangle; neighbours need not agree
    surface   nodes (n,3) -> vertices (V,3) of the mesh, where every vertex has one place
    """

    patch: Patch
    rest: FloatArray
    mass: FloatArray
    owner: IntArray
    energies: tuple[Energy, ...]
    forms: Forms
    corners: Callable[[FloatArray], FloatArray]
    surface: Callable[[FloatArray], FloatArray]

    @cached_property
    def free(self) -> BoolArray:
        """(n,) nodes that nothing holds."""
        made: BoolArray = self.owner < 0
        return made

    @cached_property
    def assembly(self) -> Assembly:
        """Energies and derivatives."""
        return Assembly(self.energies, len(self.rest))

    @cached_property
    def force(self) -> FloatArray:
        """(n,3) weight of every node [N]."""
        return np.outer(self.mass, np.asarray(self.patch.gravity))

    def at(self, time: float) -> Assembly:
        """Energies with the guides of a time; the pattern is that of ``assembly``."""
        if not self.patch.guides:
            return self.assembly
        count = len(self.patch.guides)
        own, moving = self.energies[:-count], self.energies[-count:]
        turned = tuple(
            replace(term, params=guided(len(guide.faces), guide.weight, guide.normal(time)))
            for term, guide in zip(moving, self.patch.guides, strict=True)
        )
        return Assembly((*own, *turned), len(self.rest))

    def held(self, x: FloatArray, time: float) -> FloatArray:
        """``x`` (n,3) with the held nodes where they are at ``time``."""
        made = x.copy()
        for number, hold in enumerate(self.patch.holds):
            mine = self.owner == number
            made[mine] = hold.place(self.rest[mine], time)
        return made

    def energy(self, x: FloatArray) -> float:
        """Elastic energy [J], that of guides left out."""
        return self.assembly.energy(x, self.rest, load=0.0) + self.forms.energy(x)
