"""The shell of Ly 2018, Sec. 4: edge stretching, hinge bending and weight."""

from __future__ import annotations

from casashell.engine.energy import Energy
from casashell.mesh import TriMesh
from casashell.typing import ArrayLike
from formulations.area_gravity import area_gravity
from formulations.edge_stretch import edge_stretch
from formulations.hinge_bending import hinge_bending


def discrete_shell(
    mesh: TriMesh,
    *,
    density: ArrayLike,
    stretch: ArrayLike,
    bend: ArrayLike,
    gravity: ArrayLike = (0.0, 0.0, -9.81),
) -> tuple[Energy, ...]:
    """Energies of a discrete shell on ``mesh`` (Ly 2018, Eqs. 9-12).

    density  [kg/m2], scalar or (F,);  stretch  [N], scalar or (E,);  bend  [J], scalar or (H,);
    gravity  [m/s2], (3,).  Terms that vanish everywhere (no bending, no weight) are kept: they
    carry the material into result files and cost nothing, a solve skips them.
    Raises ValueError for negative, non-finite or wrongly shaped values, naming the element.
    """
    return (
        edge_stretch(mesh, stretch),
        hinge_bending(mesh, bend),
        area_gravity(mesh, density, gravity),
    )
