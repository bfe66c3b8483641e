"""What the machine needs to know of a ribbon's physics: densities of one crease, quad or station."""

from __future__ import annotations

from dataclasses import dataclass, fields

import casadi as ca


@dataclass(frozen=True, eq=False)
class RibbonPhysics:
    """SX functions (x (3,k), r (3,k), p (m,)) -> J over columns of the station table.

    Columns of x, and the parameters p; c, b, t, n are a station's coordinates, points and normal:

    sadowsky    (c)                       D, W, h, natural angle
    wunderlich  (c, c, c)                 D, W, h, natural angle, length between the neighbours
    rulings     (c)                       weight [J], slope wanted
    gravity     (c, c, b, b, t, t)        rho, l, W, g (3)
    guiding     (n)                       weight [J], normal wanted (3)
    load        (c, c, b, b, t, t)        force (3), s, y, begin, l, W
    attachment  (c, c, b, b, t, t)        multiplier (3), place wanted (3), s, y, begin, l, W
    consistent  (c, c, b, b, t, t)        rho, l, W, h, abscissa, 26 numbers for each point
    lumped      (b, t)                    mass, h, centre without forces (3)
    smooth      (b, t, n, b, t, n)        multipliers (6), L: closes a ribbon with a flat junction
    crease      (b, t, n, b, t, n)        multipliers (5), L: closes it with a crease
    held        (b, t, n)                 multipliers (6), middle (3), frame (9), L: end in place
    junction    (b, t, n, b, t, n)        D, W, h, natural angle, 1 for a loop or -1 for Moebius
    ruling      (c)                       multiplier, slope: a ruling that does not turn
    link        (c, b, t, n, c, b, t, n)  multipliers (9), l, W, unit: one quad of the map
    rigid_begin (b, t, n)                 multipliers (3), W: the first ruling is rigid
    linear_piece, hermite_piece           knots (4,), values (3,4) -> coefficients (3,4)
    """

    sadowsky: ca.Function
    wunderlich: ca.Function
    rulings: ca.Function
    gravity: ca.Function
    guiding: ca.Function
    load: ca.Function
    attachment: ca.Function
    consistent: ca.Function
    lumped: ca.Function
    smooth: ca.Function
    crease: ca.Function
    held: ca.Function
    junction: ca.Function
    ruling: ca.Function
    link: ca.Function
    rigid_begin: ca.Function
    linear_piece: ca.Function
    hermite_piece: ca.Function

    def __post_init__(self) -> None:
        for entry in fields(self):
            value = getattr(self, entry.name)
            if not isinstance(value, ca.Function):
                raise ValueError(f"physics: {entry.name} must be a CasADi function, got {value!r}")
