"""From sheet properties to the parameters of the discrete shell on one mesh.

A sheet has a membrane stiffness Y = E t [N/m] (force per width and strain, pulled in one direction)
and a bending rigidity B [N m] (moment per width and curvature).  The discrete shell has k_L [N] per
edge and k_theta [J] per hinge, and how stiff it is depends on the mesh.  Both maps equate energies of
homogeneous states, averaged over the direction of the state, with the mesh's own triangles:

    stretching   k_L / 2 sum L strain^2              = Y / 2 A strain^2 / (1 - 1/9)
    bending      k_theta / 2 sum 3 L^2 / A_h theta^2 = B / 2 A curvature^2

The first is uniaxial strain; springs have Poisson's ratio 1/3, and the mean of cos^4 is 3/8, which makes
Y = k_L L / (3 A).  theta is what a cylinder through the vertices of a hinge bends it by.  The sheet is as
stiff as the harmonic mean of its elements: a sliver is far stiffer than its neighbours, which bend
instead.  On equilateral triangles of side a both maps are exact and isotropic: k_L = sqrt(3)/2 a Y, and
k_theta = B/3 with a coupling of the two curvatures of -1/3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casashell.mesh import TriMesh
from casashell.typing import FloatArray


@dataclass(frozen=True)
class Calibration:
    """Parameters per sheet property on one mesh, and how uneven the mesh makes the sheet.

    stretch        k_L / Y [m];  bend  k_theta / B [1]
    stretch_range  local membrane stiffness over the mean: 10th and 90th percentile by area
    bend_range     the same of the bending rigidity
    """

    stretch: float
    bend: float
    stretch_range: tuple[float, float]
    bend_range: tuple[float, float]


def calibrate(mesh: TriMesh) -> Calibration:
    """Uniform k_L and k_theta that make ``mesh`` as stiff as a sheet.

    Raises ValueError for a mesh without hinges, which cannot bend.
    """
    if len(mesh.hinges) == 0:
        raise ValueError("a mesh without interior edges has no bending rigidity to calibrate")
    membrane = _membrane_per_stretch(mesh)
    rigidity, area = _rigidity_per_bend(mesh)
    mean_membrane = 1.0 / float(np.average(1.0 / membrane, weights=mesh.face_areas))
    mean_rigidity = 1.0 / float(np.average(1.0 / rigidity, weights=area))
    return Calibration(
        stretch=1.0 / mean_membrane,
        bend=1.0 / mean_rigidity,
        stretch_range=_percentiles(membrane / mean_membrane, mesh.face_areas),
        bend_range=_percentiles(rigidity / mean_rigidity, area),
    )


def _membrane_per_stretch(mesh: TriMesh) -> FloatArray:
    """Y / k_L of every face (F,) [1/m]; an interior edge belongs to its two faces by halves."""
    corners = mesh.vertices[mesh.faces]
    length = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    ends = np.sort(np.stack([mesh.faces, np.roll(mesh.faces, -1, axis=1)], axis=2), axis=2)
    key = ends[:, :, 0] * len(mesh.vertices) + ends[:, :, 1]
    _, place, uses = np.unique(key, return_inverse=True, return_counts=True)
    share = length / uses[place.reshape(key.shape)]
    return np.asarray(share.sum(axis=1) / (3.0 * mesh.face_areas))


def _rigidity_per_bend(mesh: TriMesh) -> tuple[FloatArray, FloatArray]:
    """B / k_theta of every hinge (H,), and its area (H,) [m2].

    A third of its two triangles belongs to a hinge.  Along the edge (t) and across it (n), with the
    hinge laid flat, the height H(t, n) / 2 of a surface of curvature H folds it by
    theta = H_nn (h1 + h2) / 2 + H_tn (s1 - s2) + H_tt (s1 (s1 - L) / h1 + s2 (s2 - L) / h2) / 2.
    """
    i, j, k, el = (mesh.vertices[column] for column in mesh.hinges.T)
    edge = j - i
    length = np.linalg.norm(edge, axis=1)
    along = edge / length[:, None]
    feet, heights = [], []
    for apex in (k - i, el - i):
        foot = (apex * along).sum(axis=1)
        feet.append(foot)
        heights.append(np.linalg.norm(apex - foot[:, None] * along, axis=1))
    (s1, s2), (h1, h2) = feet, heights
    across = 0.5 * (h1 + h2)
    twist = s1 - s2
    lengthwise = 0.5 * (s1 * (s1 - length) / h1 + s2 * (s2 - length) / h2)
    # Mean over the directions of a cylinder of unit curvature: H = (cos, sin) (cos, sin)^T.
    folded = (3.0 * across**2 + 3.0 * lengthwise**2 + twist**2 + 2.0 * across * lengthwise) / 8.0
    both = length * across  # area of the two triangles
    return 9.0 * length**2 / both**2 * folded, both / 3.0


def _percentiles(values: FloatArray, weights: FloatArray) -> tuple[float, float]:
    """Weighted 10th and 90th percentile."""
    order = np.argsort(values)
    share = np.cumsum(weights[order]) / weights.sum()
    low, high = np.searchsorted(share, (0.1, 0.9))
    return float(values[order[low]]), float(values[order[min(high, len(order) - 1)]])
