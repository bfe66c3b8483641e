"""A strip of paper let go at its free end: time steps, and where it comes to rest."""

import numpy as np

from casashell.ribbon import Body, Ribbon, Scene, simulate
from formulations import ribbon_physics

# rho g L^3 / D = 23.25.
strip = Ribbon(0.2, 0.03, 20, stiffness=2.7e-4, density=0.08, clamp_crease=True)
motion = simulate(Scene((Body(strip),), ribbon_physics()), seconds=4.0, step=0.05)
print(f"{motion.status}: {motion.message}")

track = motion.tracks[0]
tip = track.middle[:, -1] / strip.length
for t, (x, _, z) in list(zip(motion.times, tip))[::10]:
    print(f"{t:5.2f} s  tip at ({x:6.3f}, {z:6.3f}) L")

# Euler's heavy elastica; 20 segments are 2e-3 from it.
if np.abs(tip[-1] - [0.40464, 0.0, -0.84812]).max() > 5e-3:
    raise SystemExit("the strip does not rest where the elastica does")
