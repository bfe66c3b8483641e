"""Natural shapes of elastic shells in frictional contact.

The machine; the physics is in the package ``formulations`` beside it.
"""

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

__version__ = "0.1.0"

__all__ = [
    "Capsule",
    "Certificate",
    "Cone",
    "Contacts",
    "Cylinder",
    "Energy",
    "Finding",
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
    "codegen",
    "inspect_mesh",
    "read_mesh",
    "repaired",
    "solve",
    "validate",
    "write_mesh",
]
