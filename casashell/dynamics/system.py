"""The equations of motion of one implicit Euler step, without contact.

    unknown  d (V,3) = x - x_n  [m],  v = d / h
    g(d)     = M (d - h v_n) / h^2 + dE/dx (x_n + d, r) + damping - wind          [N]
    A        = dg/dd

With g = 0 at every vertex that nothing touches, g = contact force where something does.  At rest
(v_n = 0, d = 0) g is dE/dx, which is what the statics balance: an equilibrium is a fixed point.
All matrices share one pattern: that of the energies and the faces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from casashell.dynamics.air import Wind
from casashell.engine.assembly import Assembly, Pattern
from casashell.engine.energy import Energy
from casashell.engine.kernels import Kernel, get_kernel
from casashell.typing import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Damping:
    """Rayleigh damping, none by default.

    mass       1/s: force -mass M v, the air of a room
    stiffness  s: force -stiffness K v with K the convex part of d2E/dx2 at the start of the step
    """

    mass: float = 0.0
    stiffness: float = 0.0

    def __post_init__(self) -> None:
        for name in ("mass", "stiffness"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise ValueError(f"damping {name} must be a finite number >= 0, got {value}")


class Blocks:
    """The 3x3 blocks of a pattern: where they are, and which are on the diagonal."""

    def __init__(self, pattern: Pattern) -> None:
        indptr, indices = pattern.indptr, pattern.indices
        width = np.diff(indptr)[::3] // 3
        count = len(width)
        self.row: IntArray = np.repeat(np.arange(count), width)
        rank = np.arange(len(self.row)) - np.repeat(np.cumsum(width) - width, width)
        begin = indptr[3 * self.row] + 3 * rank
        offset = np.arange(3)
        stride = 3 * width[self.row]
        self.place: IntArray = (
            begin[:, None, None] + stride[:, None, None] * offset[:, None] + offset[None, :]
        )
        self.column: IntArray = indices[begin] // 3
        self.diagonal: IntArray = np.flatnonzero(self.row == self.column)


@dataclass(frozen=True, eq=False)
class Inertia:
    """What a step starts from: positions, velocities (V,3), the step [s] and the time at its end."""

    x: FloatArray
    v: FloatArray
    h: float
    time: float


class System:
    """Shell, masses, pins, wind and damping of a run; `begin` a step, then evaluate it."""

    def __init__(
        self,
        energies: Sequence[Energy],
        rest: FloatArray,
        mass: FloatArray,
        pinned: IntArray,
        faces: IntArray,
        wind: Wind | None,
        damping: Damping,
        *,
        interpreted: bool = False,
    ) -> None:
        count = len(rest)
        self.rest, self.mass, self.faces = rest, mass, faces
        self.wind, self.damping = wind, damping
        self.assembly = Assembly(energies, count, interpreted=interpreted)
        self.interpreted = interpreted
        terms = list(self.assembly.energies)
        if wind is not None:
            self._blown = Energy("wind", wind.density, faces, np.ones((len(faces), _width(wind))))
            terms.append(self._blown)
        self._layout = Assembly(terms, count, interpreted=interpreted)
        self.pattern = self._layout.pattern
        self.blocks = Blocks(self.pattern)
        self.diagonal: IntArray = np.flatnonzero(self.pattern.rows == self.pattern.indices)
        self.free: BoolArray = np.ones(count, dtype=bool)
        self.free[pinned] = False
        self.start: Inertia | None = None
        self._kernels: dict[tuple[int, str], Kernel] = {}

    @property
    def compiled(self) -> bool:
        """Whether the kernels run as compiled C."""
        return self.assembly.compiled

    @cached_property
    def _home(self) -> IntArray | None:
        """Places of the energies' pattern in the common one; None when they are the same."""
        own = self.assembly.pattern
        if own.key == self.pattern.key or own.nnz == self.pattern.nnz:
            return None
        size = self.pattern.size
        wanted = own.rows * size + own.indices
        return np.searchsorted(self.pattern.rows * size + self.pattern.indices, wanted)

    def _spread(self, data: FloatArray) -> FloatArray:
        if self._home is None:
            return data
        made = np.zeros(self.pattern.nnz)
        made[self._home] = data
        return made

    def begin(self, start: Inertia) -> None:
        """Freeze what a step takes from its start: wind coefficients and the damping matrix."""
        self.start = start
        h = start.h
        self._inertia = np.repeat(self.mass * (1.0 / h**2 + self.damping.mass / h), 3)
        self._drag: FloatArray | None = None
        if self.wind is not None:
            corners, moving = start.x[self.faces], start.v[self.faces]
            self._drag = np.ascontiguousarray(
                self.wind.parameters(start.time, h, corners.mean(axis=1), moving.mean(axis=1))
            )
        self._viscous: FloatArray | None = None
        if self.damping.stiffness > 0.0:
            self._viscous = self.damping.stiffness / h * self.convex(start.x)

    def convex(self, x: FloatArray) -> FloatArray:
        """Entries of d2E/dx2 at ``x`` with the negative part of every stencil left out."""
        data = np.zeros(self.pattern.nnz)
        for term in self.assembly.energies:
            kernel = self._kernel(term, "hessian")
            block = kernel(x, self.rest, term.params, term.stencils, x)[-1]
            if not block.size:
                continue
            size = 3 * term.size
            values, vectors = np.linalg.eigh(block.reshape(-1, size, size))
            kept = (vectors * np.maximum(values, 0.0)[:, None, :]) @ vectors.transpose(0, 2, 1)
            place = self._layout.scatter_map(term).ravel()
            data += np.bincount(place, kept.ravel(), minlength=len(data))
        return data

    def _begun(self) -> Inertia:
        if self.start is None:
            raise RuntimeError("System.begin comes before its evaluation")
        return self.start

    def force(self, d: FloatArray) -> FloatArray:
        """g(d) (V,3) [N]."""
        start = self._begun()
        x = start.x + d
        return self._rest_of(d, self.assembly.gradient(x, self.rest), self._blow(x, "gradient")[0])

    def linearised(self, d: FloatArray, *, convex: bool = False) -> tuple[FloatArray, FloatArray]:
        """g(d) (V,3) [N] and the entries of A [N/m]; ``convex``: with the convex part of d2E/dx2."""
        start = self._begun()
        x = start.x + d
        gradient, data = self.assembly.hessian(x, self.rest)
        entries = self.convex(x) if convex else self._spread(data)
        blown, blocks = self._blow(x, "hessian")
        if blocks is not None:
            place = self._layout.scatter_map(self._blown).ravel()
            entries = entries + np.bincount(place, blocks.ravel(), minlength=len(entries))
        if self._viscous is not None:
            entries = entries + self._viscous
        entries = np.array(entries)
        entries[self.diagonal] += self._inertia
        return self._rest_of(d, gradient, blown), entries

    def _rest_of(self, d: FloatArray, gradient: FloatArray, blown: FloatArray) -> FloatArray:
        start = self._begun()
        h, mass = start.h, self.mass[:, None]
        g = gradient + mass * ((d - h * start.v) / h**2 + self.damping.mass / h * d) + blown
        if self._viscous is not None:
            g += (self.pattern.matrix(self._viscous) @ d.ravel()).reshape(-1, 3)
        return np.asarray(g)

    def _blow(self, x: FloatArray, name: str) -> tuple[FloatArray, FloatArray | None]:
        """Gradient (V,3) of the wind's potential, and its blocks when ``name`` is "hessian"."""
        if self._drag is None:
            return np.zeros_like(x), None
        start = self._begun()
        x = np.ascontiguousarray(x)
        blocks = self._kernel(self._blown, name)(x, start.x, self._drag, self.faces, x)
        index = (3 * self.faces[:, :, None] + np.arange(3)).ravel()
        total = np.bincount(index, blocks[0].ravel(), minlength=x.size).reshape(-1, 3)
        return np.asarray(total, dtype=np.float64), blocks[1] if name == "hessian" else None

    def _kernel(self, term: Energy, name: str) -> Kernel:
        key = id(term), name
        if key not in self._kernels:
            self._kernels[key] = get_kernel(term.density, name, interpreted=self.interpreted)
        return self._kernels[key]

    def action(self, d: FloatArray) -> float:
        """The function of d whose slope is g(d) [J]."""
        start = self._begun()
        h, x = start.h, np.ascontiguousarray(start.x + d)
        away = d - h * start.v
        total = self.assembly.energy(x, self.rest)
        total += 0.5 * float(self.mass @ (away * away).sum(axis=1)) / h**2
        if self.damping.mass:
            total += 0.5 * self.damping.mass / h * float(self.mass @ (d * d).sum(axis=1))
        if self._drag is not None:
            kernel = self._kernel(self._blown, "energy")
            total += float(kernel(x, start.x, self._drag, self.faces, x)[0].sum())
        if self._viscous is not None:
            flat = d.ravel()
            total += 0.5 * float(flat @ (self.pattern.matrix(self._viscous) @ flat))
        return total

    def kinetic(self, v: FloatArray) -> float:
        """Kinetic energy [J]."""
        return 0.5 * float(self.mass @ (v * v).sum(axis=1))

    def potential(self, x: FloatArray) -> float:
        """Potential energy [J]."""
        return self.assembly.energy(x, self.rest)


def _width(wind: Wind) -> int:
    return int(wind.density.numel_in(2))
