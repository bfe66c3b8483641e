"""Moebius bands from narrow to nearly as wide as they can be, against Starostin and van der Heijden 2007.

Length 2 pi, half-width w, Wunderlich's energy.  Their supplement gives U = 5.93 at w = pi / 30 and says
that U diverges at w = pi / sqrt 3.  It writes U = V / (D w), by which a circle would have 2 pi; the number
fits with a further 1 / pi, so that a circle has 2.  This factor is inferred.  Of the rest the supplement
has figures only, whose axes are what can be compared: twist within 0.22 .. 0.34 turns, U up to 30;
curvature up to 5 and torsion within -3 .. 4 for the bands up to w = 1.5.

``python -m benchmarks.ribbons_moebius`` draws docs/figures/moebius_widths.jpg.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from casashell.ribbon import Ribbon, closed
from casashell.ribbon.chain import Strip
from casashell.ribbon.loops import links
from casashell.typing import FloatArray
from formulations import ribbon_physics

LENGTH = 2.0 * np.pi
#: Half-widths; the first is the one with a published energy.
WIDTHS = (np.pi / 30, 0.2, 0.35, 0.5, 0.65, 0.8, 1.0, 1.15, 1.3, 1.5, 1.6, 1.7)
CRITICAL = np.pi / np.sqrt(3.0)
#: Published: U at the first width; axes of the figures of twist, and of curvature and torsion.
U, TWISTS, CURVED, TORSIONS = 5.93, (0.22, 0.34), 5.0, (-3.0, 4.0)
#: Rulings may come this near on a rim, in segments: at an inflection they meet there.
MARGIN = 1e-3
PICTURE = Path(__file__).parents[1] / "docs" / "figures" / "moebius_widths.jpg"
_SHOWN = (np.pi / 30, 0.5, 1.0, 1.5)


@dataclass(frozen=True, eq=False)
class Band:
    """An equilibrium, mirrored to positive twist.

    energy     over half of the circle's: the published U
    curvature  (N-1,) of the centreline at the creases, and ``torsion`` (N-1,) [1/m]
    density    (N-1,) energy of each crease's share over the mean share
    """

    w: float
    energy: float
    twist: float
    writhe: float
    curvature: FloatArray
    torsion: FloatArray
    density: FloatArray
    shape: Strip

    @property
    def densest_tenth(self) -> float:
        """Part of the energy in the tenth of the length that has most of it."""
        most = np.sort(self.density)[::-1]
        return float(most[: (len(most) + 1) // 10].sum() / most.sum())


def band(w: float, segments: int, margin: float = MARGIN) -> Band:
    """The band at rest; RuntimeError unless it is a stable equilibrium."""
    ribbon = Ribbon(
        LENGTH,
        2.0 * w,
        segments,
        ends="moebius",
        energy="wunderlich",
        regulariser=1e-6,
        margin=margin,
    )
    found = closed(ribbon, ribbon_physics()).require()
    shape = found.strip()
    turns = links(shape, moebius=True)
    side = np.sign(turns.twist)
    c, beta = found.state.slopes, found.state.angles
    curvature = np.abs(beta) / (ribbon.segment * np.sqrt(1.0 + c**2))
    fan = np.convolve(np.concatenate([[0.0], c, [0.0]]), [1.0, 0.0, -1.0], "valid")
    y = np.clip(0.5 * w * np.abs(fan) / ribbon.segment, 1e-6, 1.0 - 1e-12)
    density = beta**2 * (1.0 + c**2) * np.arctanh(y) / y
    half_circle = np.pi**2 * ribbon.stiffness * ribbon.width / LENGTH
    return Band(
        w,
        found.energy / half_circle,
        float(side * turns.twist),
        float(side * turns.writhe),
        curvature,
        np.asarray(side * curvature * c),
        np.asarray(density / density.mean()),
        shape,
    )


def divergence(bands: Sequence[Band]) -> float:
    """Half-width at which 1 / U, a line through the given bands, vanishes."""
    slope, start = np.polyfit([b.w for b in bands], [1.0 / b.energy for b in bands], 1)
    return float(-start / slope)


def moebius(segments: int = 120) -> list[str]:
    """Lines of a table over the width."""
    lines = [
        "| w | L / W | U | with half the segments | over the circle | Tw | Wr | largest curvature "
        "| torsion | energy in the densest tenth |",
        "|" + "---|" * 10,
    ]
    bands = [band(w, segments) for w in WIDTHS]
    for b in bands:
        coarse = band(b.w, segments // 2)
        lines.append(
            f"| {b.w:.3f} | {LENGTH / (2 * b.w):.2f} | {b.energy:.3f} | {coarse.energy:.3f} "
            f"| {b.energy / 2:.3f} | {b.twist:.3f} | {b.writhe:.3f} | {b.curvature.max():.2f} "
            f"| {b.torsion.min():.2f} .. {b.torsion.max():.2f} | {b.densest_tenth:.2f} |"
        )
        print(lines[-1], flush=True)
    return [
        *lines,
        "",
        f"Published: U = {U} at w = pi / 30, here {bands[0].energy:.3f}; U diverges at w = {CRITICAL:.4f}, "
        f"here 1 / U of the last three vanishes at {divergence(bands[-3:]):.3f}.",
    ]


def draw(bands: Sequence[Band], path: Path) -> None:
    """Shapes coloured by energy, energy and twist over the width, and two diagrams of the centreline."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 7.2), dpi=110, layout="constrained")
    upper, lower = figure.subfigures(2, 1)
    shown = [min(bands, key=lambda b: abs(b.w - w)) for w in _SHOWN]
    for k, b in enumerate(shown):
        place = (0.25 * k + 0.01, 0.0, 0.23, 0.9)
        _surface(upper.add_axes(place, projection="3d", in_layout=False), b)
    energy, diagram, along = lower.subplots(1, 3)
    w = [b.w for b in bands]
    energy.plot(w, [b.energy for b in bands], "o-", color="#0072b2", label="U")
    energy.plot(bands[0].w, U, "*", color="#d55e00", markersize=14, label="U = 5.93, published")
    energy.axvline(CRITICAL, color="0.6", linestyle=":")
    energy.set(xlabel="half-width w (length 2π)", ylabel="U", ylim=(0, 30), xlim=(0, 2))
    twist = energy.twinx()
    twist.plot(w, [b.twist for b in bands], "s--", color="#009e73", label="Tw (right)")
    twist.set(ylabel="Tw", ylim=TWISTS)
    handles = [*energy.get_legend_handles_labels()[0], *twist.get_legend_handles_labels()[0]]
    energy.legend(handles=handles, frameon=False, loc="upper center")
    for b in shown:
        diagram.plot(b.curvature, b.torsion, label=f"w = {b.w:.2f}")
        s = np.arange(1, len(b.density) + 1) / (len(b.density) + 1)
        along.semilogy(s, b.density)
    diagram.set(xlabel="curvature", ylabel="torsion", xlim=(0, 5.5), ylim=(-4, 4))
    diagram.axhspan(*TORSIONS, xmax=CURVED / 5.5, color="0.94", zorder=0)
    diagram.legend(frameon=False, loc="lower left")
    along.set(xlabel="s / L", ylabel="energy over its mean", ylim=(1e-3, 20))
    figure.savefig(path)


def _surface(axes, b: Band) -> None:  # type: ignore[no-untyped-def]
    from matplotlib import colormaps
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    bottom, top = b.shape.bottom, b.shape.top
    quads = np.stack([bottom[:-1], bottom[1:], top[1:], top[:-1]], axis=1)
    share = np.concatenate([[b.density[0]], b.density, [b.density[-1]]])
    each = np.sqrt(np.maximum(0.5 * (share[1:] + share[:-1]), 0.0))
    colours = colormaps["viridis"](np.clip(each / 2.2, 0.0, 1.0))
    axes.add_collection3d(
        Poly3DCollection(quads, facecolors=colours, edgecolors="k", linewidths=0.15)
    )
    points = quads.reshape(-1, 3)
    middle, reach = (
        0.5 * (points.max(axis=0) + points.min(axis=0)),
        np.ptp(points, axis=0).max() / 2,
    )
    for k, name in enumerate("xyz"):
        getattr(axes, f"set_{name}lim")(middle[k] - reach, middle[k] + reach)
    axes.set_box_aspect((1, 1, 1), zoom=1.3)
    axes.set_axis_off()
    axes.set_title(f"L / W = {LENGTH / (2 * b.w):.2f}")


if __name__ == "__main__":
    draw([band(w, 120) for w in WIDTHS], PICTURE)
