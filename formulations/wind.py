"""Wind on the faces of a shell: drag and lift of a thin plate in moving air.

    u = w - v                          air past the face: wind w, velocity v of the face
    c = u . n                          n the unit normal; both sides are alike
    F = rho A / 2 (C_D |c| u + C_L (|u| c n - c^2 u / |u|))

Drag along the stream grows with the area it sees; lift is across the stream (u . F_L = 0) and largest
at 45 degrees.  Semi-implicit: K with F = K (w - v) is frozen at the start of the step (n, A, u from
there) and v is the velocity at its end, so F has the potential h/2 (w - v).K(w - v).  K is positive
semidefinite for C_L <= C_D, and then the air only takes energy from a shell that moves through it.
Gusts: a sum of sines with seeded phases, the same for everyone who has the seed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import casadi as ca
import numpy as np

from casashell.typing import FloatArray
from formulations.arguments import finite_vector

#: Number of sines in a gust, and the range of their periods in that of the gusts.
_WAVES, _SPREAD = 8, 2.0
#: Speed [m/s] that is added to |u| where it divides.
_STILL = 1e-9


@cache
def density() -> ca.Function:
    """Potential [J] of one face over one step.

    x, r (3,3) at the end and the start of the step, p = (w (3), v at the start (3), h, rho, C_D, C_L).
    """
    x, r, p = ca.SX.sym("x", 3, 3), ca.SX.sym("r", 3, 3), ca.SX.sym("p", 10)
    wind, before, h, air, drag, lift = p[0:3], p[3:6], p[6], p[7], p[8], p[9]
    cross = ca.cross(r[:, 1] - r[:, 0], r[:, 2] - r[:, 0])
    twice = ca.sqrt(ca.sumsqr(cross))
    normal, u = cross / twice, wind - before
    speed = ca.sqrt(ca.sumsqr(u) + _STILL**2)
    c = ca.dot(u, normal)
    facing = ca.sqrt(c**2 + _STILL**2)
    now = wind - (x[:, 0] + x[:, 1] + x[:, 2] - r[:, 0] - r[:, 1] - r[:, 2]) / (3 * h)
    along = (drag * facing - lift * c**2 / speed) * ca.sumsqr(now)
    across = lift * speed * ca.dot(now, normal) ** 2
    return ca.Function("face_wind", [x, r, p], [h / 2 * air * twice / 4 * (along + across)])


@dataclass(frozen=True)
class FaceWind:
    """Wind of one velocity everywhere, steady or in gusts.

    velocity  (3,) m/s, the mean
    air       kg/m3;  drag, lift: coefficients C_D, C_L of a thin plate, 0 <= C_L <= C_D
    gust      standard deviation of the gusts in the mean speed; 0: steady
    period    s, of the gusts;  seed: another seed is another weather
    onset     s over which the wind rises from nothing; 0: at once

    Raises ValueError naming the parameter that is not finite or out of range.
    """

    velocity: tuple[float, float, float]
    air: float = 1.2
    drag: float = 1.2
    lift: float = 0.6
    gust: float = 0.0
    period: float = 1.0
    seed: int = 0
    onset: float = 0.0

    def __post_init__(self) -> None:
        x, y, z = finite_vector("wind velocity", self.velocity).tolist()
        object.__setattr__(self, "velocity", (x, y, z))
        for name in ("air", "drag", "lift", "gust", "period", "onset"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise ValueError(f"wind {name} must be a finite number >= 0, got {value}")
        if self.lift > self.drag:
            raise ValueError(f"wind lift {self.lift:g} must not exceed drag {self.drag:g}")
        if self.period == 0.0:
            raise ValueError("wind period must be longer than 0 s")

    @property
    def density(self) -> ca.Function:
        """Potential of one face over one step; see `density`."""
        return density()

    @cached_property
    def _waves(self) -> tuple[FloatArray, FloatArray]:
        rng = np.random.default_rng(self.seed)
        stretch = _SPREAD ** rng.uniform(-1.0, 1.0, _WAVES)
        return 2.0 * np.pi / (self.period * stretch), rng.uniform(0.0, 2.0 * np.pi, _WAVES)

    def at(self, time: float) -> FloatArray:
        """Velocity (3,) of the air [m/s] at ``time`` [s]."""
        rate, phase = self._waves
        swing = np.sqrt(2.0 / _WAVES) * np.sin(rate * time + phase).sum()
        rise = min(1.0, time / self.onset) if self.onset > 0.0 else 1.0
        return np.asarray(rise * (1.0 + self.gust * swing) * np.array(self.velocity))

    def parameters(
        self, time: float, step: float, centres: FloatArray, velocities: FloatArray
    ) -> FloatArray:
        """p (F,10) of `density` for a step that ends at ``time``."""
        count = len(centres)
        fixed = np.tile([step, self.air, self.drag, self.lift], (count, 1))
        return np.hstack([np.tile(self.at(time), (count, 1)), velocities, fixed])
