"""All families by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from benchmarks.stress import geometry, material, support
from benchmarks.stress.case import Case

FAMILIES: Final[dict[str, Callable[[], list[Case]]]] = {
    "stretch": lambda: material.stiffness("stretch"),
    "bend": lambda: material.stiffness("bend"),
    "stretch and bend": lambda: material.stiffness("both"),
    "mesh scale": material.scales,
    "mass and gravity": material.masses,
    "slivers": geometry.slivers,
    "folds": geometry.folds,
    "anisotropy": geometry.aspects,
    "target noise": geometry.noise,
    "rigid motions": geometry.motions,
    "far from the origin": geometry.distances,
    "cone boundary": support.cone_boundary,
    "friction": support.friction,
    "number of contacts": support.contact_counts,
    "pins": support.pins,
    "pieces": support.pieces,
    "two obstacles": support.duplicates,
}
