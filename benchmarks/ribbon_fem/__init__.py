"""Finite elements for inextensible strips, to compare the ribbons with.

`strip` makes a `Patch`: a flat triangle mesh with its material and what holds it.  From a patch,
`conforming` makes a body of stiff triangles that share vertices, and `nonconforming` one of triangles
that keep their lengths and share the midpoints of their edges.  `ImplicitEuler` steps either of them,
`FastProjection` those whose lengths are kept exactly; `simulate` records positions, seconds a step, and
how far lengths and areas drift.
"""

from benchmarks.ribbon_fem.body import Body
from benchmarks.ribbon_fem.conforming import conforming
from benchmarks.ribbon_fem.fast_projection import FastProjection
from benchmarks.ribbon_fem.film import Film, drift, simulate
from benchmarks.ribbon_fem.implicit import ImplicitEuler, StepFailed
from benchmarks.ribbon_fem.nonconforming import nonconforming
from benchmarks.ribbon_fem.patch import Guide, Hold, Patch, last_column, still, strip

__all__ = [
    "Body",
    "FastProjection",
    "Film",
    "Guide",
    "Hold",
    "ImplicitEuler",
    "Patch",
    "StepFailed",
    "conforming",
    "drift",
    "last_column",
    "nonconforming",
    "simulate",
    "still",
    "strip",
]
