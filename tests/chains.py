"""Chains of springs between point weights, whose poses are known in closed form.

The chain is one long side of a strip of triangles, because a problem needs a surface; the vertices of
the other side are held and feel nothing.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from meshes import grid

from casashell.engine.energy import Energy
from casashell.inverse.piece import Piece, split
from casashell.problem import Problem
from casashell.typing import FloatArray, IntArray


def chain(links: FloatArray, stretch: float, weight: float) -> tuple[Piece, FloatArray]:
    """Piece of a chain with natural ``links`` [m], and its natural shape: straight, along y.

    stretch [N] times the strain is a link's tension; every node weighs ``weight`` [N].  Nodes are
    vertices 0 to n; the others are pinned.
    """
    n = len(links)
    strip = grid(1, n, 0.1, float(np.mean(links)))
    rest = strip.vertices.copy()
    rest[:, 1] = np.tile(np.concatenate([[0.0], np.cumsum(links)]), 2)
    mesh = strip.moved(rest)
    nodes = np.arange(n + 1)
    terms = (_springs(np.stack([nodes[:-1], nodes[1:]], axis=1), stretch), _weights(nodes, weight))
    problem = Problem(mesh, terms, pinned=np.arange(n + 1, 2 * n + 2))
    (piece,) = split(problem, interpreted=True)
    return piece, piece.target.copy()


def _springs(ends: IntArray, stretch: float) -> Energy:
    """Links of energy ``stretch (L - L_r)^2 / (2 L_r)``."""
    x, r, p = ca.SX.sym("x", 3, 2), ca.SX.sym("r", 3, 2), ca.SX.sym("p", 1)
    now, rest = ca.norm_2(x[:, 1] - x[:, 0]), ca.norm_2(r[:, 1] - r[:, 0])
    density = ca.Function("link", [x, r, p], [p / 2 * (now - rest) ** 2 / rest])
    return Energy("links", density, ends, np.full((len(ends), 1), stretch))


def _weights(nodes: IntArray, weight: float) -> Energy:
    """The same weight at every node, whatever the natural shape."""
    x, r, p = ca.SX.sym("x", 3, 1), ca.SX.sym("r", 3, 1), ca.SX.sym("p", 1)
    density = ca.Function("point_weight", [x, r, p], [p * x[2]])
    return Energy("weight", density, nodes[:, None], np.full((len(nodes), 1), weight), load=True)


def with_nodes(piece: Piece, nodes: FloatArray) -> FloatArray:
    """The piece's target with the nodes of the chain at ``nodes`` (n + 1,3)."""
    pose = piece.target.copy()
    pose[: len(nodes)] = nodes
    return pose
