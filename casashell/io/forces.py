"""Contact forces as they are drawn: share of the friction in use, arrows, words for the legend."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from casashell.io.labels import engineering
from casashell.io.tessellate import Surface, arrows
from casashell.result import Result
from casashell.typing import FloatArray, IntArray

# The longest arrow, as a share of the shell's bounding box diagonal, and its shaft.
_LONGEST: Final = 0.12
_WIDTH: Final = 0.0045
# A force below this share of the largest one has no direction worth a colour.
_NOTHING: Final = 1e-6
#: Share of the available friction above which a contact is shown as slipping: 1 and rounding.
BEYOND: Final = 1.0 + 1e-6


@dataclass(frozen=True, eq=False)
class ForceArrows:
    """Arrows on the shell, one per contact.

    surface      triangles of all arrows
    owner        (n,) contact of each vertex of the surface
    use          (C,) |f_T| / (mu f_N): above 1 the contact would slip; inf where it pulls
    longest      N, the force of the longest arrow
    """

    surface: Surface
    owner: IntArray
    use: FloatArray
    longest: float

    @property
    def legend(self) -> str:
        """One line for a legend."""
        if not len(self.use):
            return "no contacts"
        return f"contact forces, longest {engineering(self.longest, 'N')}"


def force_arrows(result: Result, chosen: IntArray | None = None, sides: int = 10) -> ForceArrows:
    """Arrows of the contact forces (those ``chosen``, all by default) at the target's vertices."""
    picked = np.arange(len(result.contacts)) if chosen is None else chosen
    contacts = result.contacts
    forces = result.contact_forces[picked]
    size = np.linalg.norm(forces, axis=1)
    longest = float(size.max(initial=0.0))
    scale = _LONGEST * result.target.bbox_diagonal / longest if longest > 0 else 0.0
    tails = result.target.vertices[contacts.vertices[picked]]
    # On a fine mesh with many contacts thick arrows would hide one another.
    width = min(_WIDTH * result.target.bbox_diagonal, 0.2 * result.target.mean_edge_length)
    surface = arrows(tails, scale * forces, width, sides)
    per_arrow = len(surface.vertices) // max(len(forces), 1)
    owner = np.repeat(np.arange(len(forces), dtype=np.int64), per_arrow)
    use = friction_use(forces, contacts.normals[picked], contacts.friction[picked])
    return ForceArrows(surface, owner, use, longest)


def friction_use(forces: FloatArray, normals: FloatArray, friction: FloatArray) -> FloatArray:
    """|f_T| / (mu f_N) of each force (C,3) on the shell; 0 without force, inf where it pulls."""
    normal = np.einsum("ij,ij->i", forces, normals)
    tangential = np.linalg.norm(forces - normal[:, None] * normals, axis=1)
    least = _NOTHING * float(np.linalg.norm(forces, axis=1).max(initial=0.0))
    limit = friction * normal
    use = np.full(len(forces), np.inf)
    np.divide(tangential, limit, out=use, where=limit > 0)
    use[(tangential <= least) & (normal >= -least)] = 0.0
    return use
