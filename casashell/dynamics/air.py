"""What the machine asks of a wind."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import casadi as ca

from casashell.typing import FloatArray


@runtime_checkable
class Wind(Protocol):
    """Force of moving air on the faces; `formulations.wind` has one, write your own like it.

    density     SX function (x (3,3), r (3,3), p (m,)) -> potential [J] of one face over one step, with
                x at the end of the step and r at its start; minus its slope in x is the force
    parameters  p (F,m) from the time at the end of the step [s], the step [s], and the centres (F,3) m
                and velocities (F,3) m/s of the faces at its start
    """

    @property
    def density(self) -> ca.Function: ...

    def parameters(
        self, time: float, step: float, centres: FloatArray, velocities: FloatArray
    ) -> FloatArray: ...
