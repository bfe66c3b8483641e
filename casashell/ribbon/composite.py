"""Second derivatives of an energy of a ribbon by its coordinates, O(N^2) in time and in memory.

Crease i moves all behind it by a twist xi = (omega, v), so everything behind acts as one composite
body: the curvature of two creases i < j is xi_i . Y_j, where the wrench Y_j collects what a unit rate
of crease j does to the forces on all stations behind i.  This is the composite-rigid-body recursion of
serial robots, with blocks that couple neighbouring stations, and the curvature of the map itself:

    d2x / di dj = omega_i x (omega_j x (x - m_j)),     i < j < station of x

Directions: translation (3), rotation about the pivot (3), then (c_i, beta_i) of the stations 0..N.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from casashell.ribbon.chain import (
    BOTTOM,
    COORDINATES,
    NORMAL,
    TOP,
    Pull,
    Strip,
    cross,
    pull_back,
    suffix,
)
from casashell.typing import FloatArray, IntArray

#: Numbers of a node: bottom, top, normal of the quad before, c, beta.  Node i + 1 carries normal i,
#: because crease i turns it like the points of station i + 1.
NODE = 11


@dataclass(frozen=True)
class BandLayout:
    """Where second derivatives by the station table go: blocks of nodes, or pairs of coordinates."""

    stations: int

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Numbers in the diagonal blocks, the blocks above them, and between coordinates."""
        m = self.stations
        return (m + 1) * NODE**2, m * NODE**2, (2 * m) ** 2

    @property
    def size(self) -> int:
        """Numbers in a buffer; the last one collects what is not kept."""
        return sum(self.sizes) + 1

    def places(self, stencils: IntArray) -> IntArray:
        """(S, 3k, 3k) places in a buffer for the blocks of stencils (S,k) of rows of the table.

        Raises ValueError for a stencil that couples points further apart than a quad.
        """
        station, row = np.divmod(stencils, 4)
        node = station + (row == NORMAL)
        within = np.empty((*stencils.shape, 3), dtype=np.int64)
        for kind, first in ((COORDINATES, 9), (BOTTOM, 0), (TOP, 3), (NORMAL, 6)):
            within[row == kind] = first + np.arange(3)
        dropped = within > NODE - 1  # the third number of coordinates is not used
        count = len(stencils)
        node = np.repeat(node, 3, axis=1)
        within, dropped = within.reshape(count, -1), dropped.reshape(count, -1)
        here, there = node[:, :, None], node[:, None, :]
        place = (here * NODE + within[:, :, None]) * NODE + within[:, None, :]
        diagonal, above, _ = self.sizes
        made = np.full(place.shape, self.size - 1, dtype=np.int64)
        made = np.where(here == there, place, made)
        made = np.where(there == here + 1, diagonal + place, made)
        flat = within >= 9
        both = flat[:, :, None] & flat[:, None, :]
        number = 2 * node + within - 9
        pair = diagonal + above + 2 * self.stations * number[:, :, None] + number[:, None, :]
        made = np.where(both, pair, made)
        unused = dropped[:, :, None] | dropped[:, None, :]
        if np.any((np.abs(here - there) > 1) & ~both & ~unused):
            raise ValueError("an energy of a ribbon couples points further apart than one quad")
        return np.where(unused, self.size - 1, made)

    def split(self, buffer: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Views: blocks of nodes (N+2,11,11), of neighbours (N+1,11,11), coordinates (2N+2,2N+2)."""
        m, (diagonal, above, _) = self.stations, self.sizes
        return (
            buffer[:diagonal].reshape(m + 1, NODE, NODE),
            buffer[diagonal : diagonal + above].reshape(m, NODE, NODE),
            buffer[diagonal + above : -1].reshape(2 * m, 2 * m),
        )


@dataclass(frozen=True, eq=False)
class Placed:
    """A strip that turns about ``pivot`` (3,) [m] with angular velocities ``turns`` (3,3), one a row.

    The three turns are joints in series: a later one is carried by those before it.
    """

    shape: Strip
    pivot: FloatArray
    turns: FloatArray

    @cached_property
    def centre(self) -> FloatArray:
        """(N+1,3) centreline points seen from the pivot."""
        return self.shape.middle - self.pivot

    @cached_property
    def twists(self) -> FloatArray:
        """(N+1,2,6) motion of all behind a crease, for unit rates of c and beta."""
        spins = self.shape.spins
        return np.concatenate([spins, cross(self.centre[:, None], spins)], axis=2)

    @cached_property
    def base_twists(self) -> FloatArray:
        """(6,6) of translation and rotation."""
        made = np.zeros((6, 6))
        made[:3, 3:], made[3:, :3] = np.eye(3), self.turns
        return made

    @cached_property
    def local(self) -> FloatArray:
        """(N+1,2,11) what c and beta of a station change in its own node."""
        made = np.zeros((len(self.centre), 2, NODE))
        made[:, 0, :3], made[:, 0, 3:6] = -self.shape.slide, self.shape.slide
        made[:, 0, 9] = made[:, 1, 10] = 1.0
        return made

    @cached_property
    def lever(self) -> FloatArray:
        """(N+2,11,6) from a twist about the pivot to the rates of a node."""
        m = len(self.centre)
        made = np.zeros((m + 1, NODE, 6))
        arms = self.shape.arms
        for first, points in ((0, self.centre - arms), (3, self.centre + arms)):
            _minus_skew(made[:-1, first : first + 3, :3], points)
            made[:-1, first : first + 3, 3:] = np.eye(3)
        _minus_skew(made[1:, 6:9, :3], self.shape.behind[:, :, 2])
        return made

    def gradient(self, table: FloatArray) -> FloatArray:
        """(6 + 2(N+1),) derivative along the directions, from ``table`` (4 (N+1), 3)."""
        pull: Pull = pull_back(self.shape, table)
        torque = pull.torque + np.cross(self.centre[0], pull.force)
        return np.concatenate([pull.force, self.turns @ torque, pull.creases.ravel()])

    def hessian(
        self,
        table: FloatArray,
        blocks: FloatArray,
        neighbours: FloatArray,
        coordinates: FloatArray,
    ) -> FloatArray:
        """(n,n), n = 6 + 2(N+1), second derivative along the directions.

        From the gradient by the station table (4 (N+1), 3) and the second derivatives by it, as
        `BandLayout.split` gives them.
        """
        made = _composite(self, blocks, neighbours, _Moments.of(self, table))
        made[6:, 6:] += coordinates
        return made


def _minus_skew(into: FloatArray, a: FloatArray) -> None:
    """Matrices of  omega -> omega x a."""
    into[:, 0, 1], into[:, 0, 2], into[:, 1, 2] = a[:, 2], -a[:, 1], a[:, 0]
    into[:, 1, 0], into[:, 2, 0], into[:, 2, 1] = -a[:, 2], a[:, 1], -a[:, 0]


@dataclass(frozen=True, eq=False)
class _Moments:
    """First moments of the forces on all behind each crease.

    curl   (N+1,3,3) K with  sum (omega x y) x g = K omega,  y from the centreline point of the crease
    torque (N+1,3) sum y x g
    whole  (3,3) K of the whole strip about the pivot
    pinch  (N+1,3) slide x (force on the top end - force on the bottom end)
    """

    curl: FloatArray
    torque: FloatArray
    whole: FloatArray
    pinch: FloatArray

    @staticmethod
    def of(placed: Placed, table: FloatArray) -> _Moments:
        shape, g = placed.shape, table.reshape(-1, 4, 3)
        both, apart = g[:, BOTTOM] + g[:, TOP], g[:, TOP] - g[:, BOTTOM]
        point = np.einsum("ia,ib->iab", placed.centre, both)
        point += np.einsum("ia,ib->iab", shape.arms, apart)
        normal = np.einsum("ia,ib->iab", shape.behind[:, :, 2], g[:, NORMAL])
        points, normals = suffix(point), suffix(normal)
        moment = points[1:] + normals[:-1]
        moment -= np.einsum("ia,ib->iab", placed.centre, suffix(both)[1:])
        torque = np.stack([moment[:, i - 2, i - 1] - moment[:, i - 1, i - 2] for i in range(3)], 1)
        return _Moments(
            _curl(moment), torque, _curl(points[0] + normals[0]), cross(shape.slide, apart)
        )


def _curl(moment: FloatArray) -> FloatArray:
    trace = np.trace(moment, axis1=-2, axis2=-1)[..., None, None]
    return np.asarray(moment - trace * np.eye(3))


def _composite(
    placed: Placed, blocks: FloatArray, neighbours: FloatArray, moments: _Moments
) -> FloatArray:
    """Curvature without what couples coordinates directly."""
    a, xi, local = placed.lever, placed.twists, placed.local
    m = len(xi)
    coupled = neighbours @ a[1:]  # (m,11,6)
    body = np.swapaxes(a, 1, 2) @ blocks @ a
    across = np.swapaxes(a[:-1], 1, 2) @ coupled
    body[:-1] += across + np.swapaxes(across, 1, 2)
    bodies = suffix(body)
    # Rates of the forces for each direction of crease j, on node j - 1, on node j, behind.
    before = np.zeros((m, 2, NODE))
    before[1:] = local[1:] @ np.swapaxes(neighbours[:-1], 1, 2)
    here = local @ np.swapaxes(blocks[:-1], 1, 2) + xi @ np.swapaxes(coupled, 1, 2)
    rest = xi @ bodies[1:-1] + (local @ neighbours) @ a[1:]
    turning = placed.shape.spins @ np.swapaxes(moments.curl, 1, 2)
    turning[:, 0] += moments.pinch
    from_here = here @ a[:-1] + rest
    from_here[:, :, :3] += turning
    wrench = from_here.copy()
    wrench[1:] += before[1:] @ a[:-2]
    made = np.zeros((6 + 2 * m, 6 + 2 * m))
    made[6:, 6:] = _staircase(xi.reshape(-1, 6) @ wrench.reshape(-1, 6).T, m)
    rows = 6 + 2 * np.arange(m)
    side = np.einsum("iak,ibk->iab", xi[:-1], from_here[1:])
    side += np.einsum("iak,ibk->iab", local[:-1], before[1:])
    own = np.einsum("iak,ibk->iab", xi, rest) + np.einsum("iak,ibk->iab", local, here)
    own += _same_crease(placed.shape, moments)
    for p in range(2):
        for q in range(2):
            made[rows[:-1] + p, rows[1:] + q] = side[:, p, q]
            made[rows[1:] + q, rows[:-1] + p] = side[:, p, q]
            made[rows + p, rows + q] = own[:, p, q]
    made[:6, 6:] = placed.base_twists @ wrench.reshape(-1, 6).T
    made[6:, :6] = made[:6, 6:].T
    made[:6, :6] = placed.base_twists @ bodies[0] @ placed.base_twists.T
    turned = placed.turns @ moments.whole @ placed.turns.T
    made[3:6, 3:6] += np.triu(turned) + np.triu(turned, 1).T
    return made


def _staircase(product: FloatArray, m: int) -> FloatArray:
    """Entries of creases at least two apart, the earlier one in the row; then made symmetric."""
    station = np.arange(2 * m) // 2
    upper = np.where(station[:, None] < station[None, :] - 1, product, 0.0)
    return upper + upper.T


def _same_crease(shape: Strip, moments: _Moments) -> FloatArray:
    """(N+1,2,2) forces on the second derivative of one crease's own rotation."""
    c, beta, spins = shape.slopes, shape.angles, shape.spins
    root = 1.0 / np.sqrt(1.0 + c * c)
    sine, cosine, turn = np.sin(beta), np.cos(beta), 2.0 * np.sin(0.5 * beta) ** 2
    mixed, twice = np.zeros((len(c), 3)), np.zeros((len(c), 3))
    mixed[:, 0], mixed[:, 1] = cosine * root**3, -c * cosine * root**3
    mixed[:, 2] = -sine * root**2
    twice[:, 0], twice[:, 1] = -3.0 * c * sine * root**5, (2.0 * c * c - 1.0) * sine * root**5
    twice[:, 2] = 2.0 * c * turn * root**4
    local = np.einsum("iab,ia->ib", shape.before, moments.torque)
    made = np.asarray(np.einsum("ipa,iab,iqb->ipq", spins, moments.curl, spins))
    made[:, 0, 0] += np.einsum("ia,ia->i", twice, local)
    both = made[:, 0, 1] + np.einsum("ia,ia->i", mixed, local)
    made[:, 0, 1] = made[:, 1, 0] = both
    return made
