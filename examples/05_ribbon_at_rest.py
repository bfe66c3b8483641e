"""A Moebius band of paper: its energy over that of a round loop, and how its twist is shared out."""

import math

from casashell.ribbon import Ribbon, closed
from casashell.ribbon.loops import links
from formulations import ribbon_physics

physics = ribbon_physics()
length, width = 2.0 * math.pi, 2.0 * math.pi / 30.0
band = Ribbon(length, width, 60, ends="moebius", energy="wunderlich", margin=0.02, regulariser=1e-6)

found = closed(band, physics).require()  # raises unless it is a stable equilibrium
circle = 2.0 * math.pi**2 * band.stiffness * width / length
turns = links(found.strip(), moebius=True)
print(f"energy over that of a circle  {found.energy / circle:.3f}")
print(f"twist, writhe, linking number {turns.twist:.3f}, {turns.writhe:.3f}, {turns.linking:.3f}")

if abs(found.energy / circle - 2.965) > 0.02 or abs(abs(turns.linking) - 0.5) > 1e-2:
    raise SystemExit("this is not the band of Starostin and van der Heijden (2007)")
