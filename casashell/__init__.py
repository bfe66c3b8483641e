"""Natural shapes of elastic shells in frictional contact.

The machine; the physics is in the package ``formulations`` beside it.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from casashell.contact.detect import Contacts
from casashell.contact.mesh_obstacle import MeshObstacle
from casashell.contact.obstacles import Capsule, Cone, Cylinder, Obstacle, Plane, Sphere
from casashell.engine.codegen import codegen
from casashell.engine.energy import Energy
from casashell.io.meshes import read_mesh, write_mesh
from casashell.mesh import TriMesh
from casashell.mesh_checks import Finding, MeshError, inspect_mesh, validate
from casashell.problem import Problem
from casashell.repair import Repair, repaired
from casashell.result import Certificate, NotConverged, Quality, Result, Step
from casashell.solve import solve
from casashell.status import Status

if TYPE_CHECKING:
    from casashell.inverse.feasibility import Feasibility, Verdict, feasibility
    from casashell.inverse.material_range import MaterialRange, material_range

__version__ = "0.1.0"

__all__ = [
    "Capsule",
    "Certificate",
    "Cone",
    "Contacts",
    "Cylinder",
    "Energy",
    "Feasibility",
    "Finding",
    "MaterialRange",
    "MeshError",
    "MeshObstacle",
    "NotConverged",
    "Obstacle",
    "Plane",
    "Problem",
    "Quality",
    "Repair",
    "Result",
    "Sphere",
    "Status",
    "Step",
    "TriMesh",
    "Verdict",
    "codegen",
    "feasibility",
    "inspect_mesh",
    "material_range",
    "read_mesh",
    "repaired",
    "solve",
    "validate",
    "write_mesh",
]

#: Names that are loaded when asked for, and where from.
_LATER = {
    **dict.fromkeys(("Feasibility", "Verdict", "feasibility"), "casashell.inverse.feasibility"),
    **dict.fromkeys(("MaterialRange", "material_range"), "casashell.inverse.material_range"),
}


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module 'casashell' has no attribute '{name}'")
    return getattr(import_module(_LATER[name]), name)
