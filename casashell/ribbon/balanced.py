"""A program in unknowns whose curvature is about one, for methods without second derivatives.

    z = z_0 + T y

T divides unknowns that keep their box, the increments of slopes, by the square root of their curvature,
and takes the others, angles and frame, which move all that is behind them, by the inverse
square root of their block of the Hessian.  Their own bounds, far away as a rule, become rows of A.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from casashell.ribbon.program import Multipliers, Outcome, Program
from casashell.typing import BoolArray, FloatArray

#: Lowest curvature that counts, over the highest.
FLOOR = 1e-8


@dataclass(frozen=True, eq=False)
class Balanced:
    """``program`` in y, made of ``plain`` in z by ``transform`` (n,n)."""

    plain: Program
    program: Program
    transform: FloatArray

    @staticmethod
    def of(plain: Program, boxed: BoolArray, penalty: float) -> Balanced:
        """By the curvature at the start, with ``penalty``/2 |C|^2; ``boxed`` (n,) keep their box.

        Raises ValueError for a program without second derivatives.
        """
        if plain.hessian is None:
            raise ValueError("balancing needs second derivatives at the start")
        start = plain.clipped(plain.start)
        c, slopes = plain.equalities(start)
        touching = len(plain.contacts(start)[0])
        hessian = plain.hessian(start, np.zeros(len(c) + touching)) + penalty * slopes.T @ slopes
        transform = _transform(hessian, boxed)
        size = np.where(boxed, np.diag(transform), 1.0)
        rows, bound = _loose(plain, boxed)
        return Balanced(
            plain,
            Program(
                start=np.zeros(len(start)),
                lower=np.where(boxed, (plain.lower - start) / size, -np.inf),
                upper=np.where(boxed, (plain.upper - start) / size, np.inf),
                objective=lambda y: _pulled(plain.objective(start + transform @ y), transform),
                equalities=lambda y: _turned(plain.equalities(start + transform @ y), transform),
                matrix=np.concatenate((plain.rows(), rows)) @ transform,
                bound=np.concatenate((plain.bound - plain.rows() @ start, bound - rows @ start)),
                contacts=lambda y: _turned(plain.contacts(start + transform @ y), transform),
            ),
            transform,
        )

    def there(self, at: Multipliers) -> Multipliers:
        """Of the program in y, for those of the program in z."""
        k = len(self.plain.bound)
        more = np.zeros(len(self.program.bound) - k)
        parts = (at.inequality[:k], more, at.inequality[k:])
        return replace(at, inequality=np.concatenate(parts))

    def back(self, found: Outcome) -> Outcome:
        """The end of a run in y, measured in z."""
        plain, at = self.plain, found.multipliers
        z = plain.clipped(plain.clipped(plain.start) + self.transform @ found.z)
        kept = np.delete(at.inequality, np.s_[len(plain.bound) : len(self.program.bound)])
        gradient = plain.objective(z)[1] + plain.equalities(z)[1].T @ at.equality
        gradient = gradient + plain.inequality_rows(z).T @ kept
        return replace(
            found,
            z=z,
            violation=plain.violation(z),
            projected_gradient=plain.projected(z, gradient),
            multipliers=replace(at, inequality=kept),
        )


def _transform(hessian: FloatArray, boxed: BoolArray) -> FloatArray:
    """T (n,n)."""
    diagonal = np.abs(np.diag(hessian))
    made = np.diag(1.0 / np.sqrt(np.maximum(diagonal, FLOOR * diagonal.max())))
    rest = np.flatnonzero(~boxed)
    if rest.size:
        values, vectors = np.linalg.eigh(hessian[np.ix_(rest, rest)])
        size = np.maximum(np.abs(values), FLOOR * np.abs(values).max())
        made[np.ix_(rest, rest)] = vectors / np.sqrt(size) @ vectors.T
    return made


def _loose(plain: Program, boxed: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Rows and bounds of those bounds that are finite and not of a box."""
    unit, rows, bound = np.eye(len(boxed)), [], []
    for side, limit in ((1.0, plain.upper), (-1.0, plain.lower)):
        which = np.flatnonzero(~boxed & np.isfinite(limit))
        rows.append(side * unit[which])
        bound.append(side * limit[which])
    return np.concatenate(rows), np.concatenate(bound)


def _pulled(value: tuple[float, FloatArray], transform: FloatArray) -> tuple[float, FloatArray]:
    return value[0], transform.T @ value[1]


def _turned(
    value: tuple[FloatArray, FloatArray], transform: FloatArray
) -> tuple[FloatArray, FloatArray]:
    return value[0], value[1] @ transform
