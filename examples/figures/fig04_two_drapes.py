"""Ly 2018, Fig. 4: one flat natural shape, two draped poses, by perturbing the initial state.

A square tablecloth is held where it lies on a round table and draped from two starts, its corners or
its sides bent down first.  Checked: both poses are minima of the energy of the same natural shape (by the
certificate, which shares no code with the drape), and edges apart.  Found: 3.8 mean edges
apart, energies -522 and -387 mJ, lowest eigenvalues 0.21 and 0.06 f0 / h, free forces below 1e-10 f0.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from casashell import Cylinder, Problem, TriMesh
from casashell.inverse.certificate import certify, total_energy
from casashell.inverse.drape import drape
from casashell.inverse.piece import split
from casashell.inverse.pulled import Pulled
from casashell.io.camera import framed
from casashell.io.sheet import Panel, write_sheet
from casashell.io.studio import Layer, Studio
from casashell.io.tessellate import Region, tessellate
from casashell.result import Certificate
from formulations import discrete_shell

CELLS, SIDE, TABLE = 24, 1.2, 0.3  # cells along a side of SIDE m; radius of the table, m
STARTS = {"corners": -1.0, "sides": 1.0}  # what is bent down first
COLOURS = (("#5b8fd0", "#3c669c"), ("#e8933a", "#b56c20"))


@dataclass(frozen=True)
class Measured:  # the poses (V,3), their energies [J], certificates, and edges between them
    problem: Problem
    poses: tuple[np.ndarray, ...]
    energies: tuple[float, ...]
    proofs: tuple[Certificate, ...]
    apart: float


def measure() -> Measured:
    line = np.linspace(-0.5 * SIDE, 0.5 * SIDE, CELLS + 1)
    x, y = (a.ravel() for a in np.meshgrid(line, line, indexing="ij"))
    i, j = (a.ravel() for a in np.meshgrid(np.arange(CELLS), np.arange(CELLS), indexing="ij"))
    ring = np.stack([k + i * (CELLS + 1) + j for k in (0, CELLS + 1, CELLS + 2, 1)], axis=1)
    ring = np.where(((i + j) % 2)[:, None], np.roll(ring, 1, axis=1), ring)  # turns the diagonal
    flat = TriMesh(np.stack([x, y, 0 * x], 1), np.vstack([ring[:, :3], ring[:, [0, 2, 3]]]))
    away = np.maximum(np.hypot(x, y) - TABLE, 0.0)
    cloth = discrete_shell(flat, density=0.3, stretch=100.0, bend=1e-3, gravity=(0, 0, -9.81))
    problem = Problem(flat, cloth, pinned=np.flatnonzero(away == 0.0))
    (piece,) = split(problem)
    poses, proofs = [], []
    for sign in STARTS.values():
        start = flat.vertices.copy()
        start[:, 2] -= away * (0.6 + 0.4 * sign * np.cos(4.0 * np.arctan2(y, x)))
        found = drape(Pulled(piece, 0.0), piece.target, start - piece.origin, piece.held)
        poses.append(found.pose + piece.origin)
        at = (problem.energies, flat.vertices, poses[-1], flat.vertices, problem.contacts)
        proofs.append(certify(*at, np.zeros((0, 3)), np.asarray(problem.pinned), piece.h)[0])
    energies = tuple(total_energy(cloth, pose, flat.vertices) for pose in poses)
    apart = float(np.linalg.norm(poses[0] - poses[1], axis=1).max()) / piece.h
    return Measured(problem, tuple(poses), energies, tuple(proofs), apart)


def draw(found: Measured, path: Path) -> None:
    flat = found.problem.target
    leg = Cylinder((0, 0, -0.66), (0, 0, 1), 0.92 * TABLE, length=0.65)
    stand = tessellate(leg, Region.around(flat.vertices))
    camera = framed(flat.vertices, stand.vertices, up=(0, 0, 1), azimuth=20, elevation=24)
    size = (round(560 * camera.aspect), 560)
    layers = [Layer(flat, "#dcdfe4", edges=True)]
    layers += [Layer(flat.moved(p), *c, edges=True) for p, c in zip(found.poses, COLOURS)]
    labels = ["flat natural shape of both"]
    labels += [f"{n} bent down first: {1e3 * e:.0f} mJ" for n, e in zip(STARTS, found.energies)]
    with Studio() as studio:
        shots = [studio.shoot([Layer(stand, "#c9c9c6"), layer], camera, size) for layer in layers]
    write_sheet([[Panel("", label, shot) for label, shot in zip(labels, shots)]], path)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("."))
    folder, found = parser.parse_args().out, measure()
    for n, e, proof in zip(STARTS, found.energies, found.proofs):
        print(f"{n} first: {1e3 * e:.1f} mJ, eigenvalue {proof.min_eigenvalue_scaled:.3f} f0/h")
    print(f"one natural shape, poses {found.apart:.2f} mean edges apart")
    folder.mkdir(parents=True, exist_ok=True)
    draw(found, folder / "fig04_two_drapes.png")
    if found.apart < 1.0 or max(p.free_force > 1e-8 or p.min_eigenvalue <= 0 for p in found.proofs):
        raise SystemExit("these are not two drapes of one natural shape")
