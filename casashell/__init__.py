"""Natural shapes of elastic shells in frictional contact.

The machine; the physics is in the package ``formulations`` beside it.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from casashell.contact.detect import Contacts
    from casashell.contact.mesh_obstacle import MeshObstacle
    from casashell.contact.obstacles import Capsule, Cone, Cylinder, Obstacle, Plane, Sphere
    from casashell.dynamics.motion import MeshSequence, Motion, RigidMotion
    from casashell.dynamics.simulate import Damping, simulate
    from casashell.dynamics.simulation import Simulation, SimulationStatus
    from casashell.engine.codegen import codegen
    from casashell.engine.energy import Energy
    from casashell.inverse.feasibility import Feasibility, Verdict, feasibility
    from casashell.inverse.material_range import MaterialRange, material_range
    from casashell.io.meshes import read_mesh, write_mesh
    from casashell.mesh import TriMesh
    from casashell.mesh_checks import Finding, MeshError, inspect_mesh, validate
    from casashell.problem import Problem
    from casashell.repair import Repair, repaired
    from casashell.result import Certificate, NotConverged, Quality, Result, Step
    from casashell.solving import solve
    from casashell.status import Status

__version__ = "0.1.0"

__all__ = [
    "Capsule",
    "Certificate",
    "Cone",
    "Contacts",
    "Cylinder",
    "Damping",
    "Energy",
    "Feasibility",
    "Finding",
    "MaterialRange",
    "MeshError",
    "MeshObstacle",
    "MeshSequence",
    "Motion",
    "NotConverged",
    "Obstacle",
    "Plane",
    "Problem",
    "Quality",
    "Repair",
    "Result",
    "RigidMotion",
    "Simulation",
    "SimulationStatus",
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
    "simulate",
    "solve",
    "validate",
    "write_mesh",
]

#: Where each name lives: loaded when asked for, so that importing the package costs nothing.
_PLACES = {
    "casashell.contact.detect": ("Contacts",),
    "casashell.contact.mesh_obstacle": ("MeshObstacle",),
    "casashell.contact.obstacles": ("Capsule", "Cone", "Cylinder", "Obstacle", "Plane", "Sphere"),
    "casashell.dynamics.motion": ("MeshSequence", "Motion", "RigidMotion"),
    "casashell.dynamics.simulate": ("Damping", "simulate"),
    "casashell.dynamics.simulation": ("Simulation", "SimulationStatus"),
    "casashell.engine.codegen": ("codegen",),
    "casashell.engine.energy": ("Energy",),
    "casashell.inverse.feasibility": ("Feasibility", "Verdict", "feasibility"),
    "casashell.inverse.material_range": ("MaterialRange", "material_range"),
    "casashell.io.meshes": ("read_mesh", "write_mesh"),
    "casashell.mesh": ("TriMesh",),
    "casashell.mesh_checks": ("Finding", "MeshError", "inspect_mesh", "validate"),
    "casashell.problem": ("Problem",),
    "casashell.repair": ("Repair", "repaired"),
    "casashell.result": ("Certificate", "NotConverged", "Quality", "Result", "Step"),
    "casashell.solving": ("solve",),
    "casashell.status": ("Status",),
}
_LATER = {name: place for place, names in _PLACES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module 'casashell' has no attribute '{name}'")
    value = getattr(import_module(_LATER[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
