"""Pan 2016, Fig. 13: cost of the gradient, and of a Moebius band's rest shape, over its segments.

The chain rule moves every point by every coordinate before it, the adjoint goes over the ribbon once.
Both give the same numbers; the rest shape is found by the paper's method with either of them, so that
only the gradient differs.  Checked: they agree to rounding; fitted exponents of a gradient are at least
1.7 and at most 1.2 over long ribbons; at 80 segments the rest shape takes longer by the chain rule.
"""

import time
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from stage import conclude, folder

from casashell.ribbon import Ribbon, Setting, closed
from casashell.ribbon.augmented import Schedule, augmented
from casashell.ribbon.bands import refined
from casashell.ribbon.chain import Strip, pull_back, strip
from casashell.ribbon.gradients import by_chain_rule, by_two_passes
from casashell.ribbon.potential import Potential
from casashell.ribbon.program import Objective
from formulations import ribbon_physics

#: Long ribbons: below a few hundred segments the adjoint is all overhead, not growth.
SEGMENTS = (50, 100, 200, 400, 800)
ADJOINT = (*SEGMENTS, 1600, 3200, 6400)
WAYS = {"chain rule": "#d0021b", "adjoint": "#1f6fd0", "adjoint, two passes": "#2a8f5b"}
BAND, BANDS = Ribbon(2.0 * np.pi, 0.2, 20, ends="moebius"), (20, 40, 80)


@dataclass(frozen=True)
class Measured:  # seconds of a gradient over segments, their exponents, largest relative difference
    times: dict[str, np.ndarray]
    exponents: dict[str, float]
    apart: float


def wavy(segments: int) -> tuple[Strip, np.ndarray]:
    """A strip and forces on its station table; nothing special about either."""
    at = np.linspace(0.0, 1.0, segments + 1)
    c, beta = 0.3 * np.sin(9.0 * at), 3.0 / segments * np.cos(7.0 * at)
    c[0] = c[-1] = 0.0
    shape = strip(10.0, 0.2, c, beta, np.eye(3), np.zeros(3))
    return shape, np.sin(np.arange(12.0 * (segments + 1))).reshape(-1, 3)


def best(call, least: float = 0.1) -> float:
    """Shortest of several runs [s]."""
    times: list[float] = []
    while sum(times) < least or len(times) < 3:
        begin = time.process_time()
        call()
        times.append(time.process_time() - begin)
    return min(times)


def measure(segments: tuple[int, ...] = SEGMENTS, adjoint: tuple[int, ...] = ADJOINT) -> Measured:
    times, apart = {name: [] for name in WAYS}, 0.0
    for n in adjoint:
        shape, g = wavy(n)
        times["adjoint"].append((n, best(partial(pull_back, shape, g))))
        if n not in segments:
            continue
        made = pull_back(shape, g).creases
        for name, other in (
            ("chain rule", partial(by_chain_rule, shape, g)),
            ("adjoint, two passes", partial(by_two_passes, 10.0, shape, g)),
        ):
            apart = max(apart, float(np.abs(other() - made).max() / np.abs(made).max()))
            times[name].append((n, best(other)))
    arrays = {name: np.array(rows) for name, rows in times.items()}
    # Of the adjoint the slope over long ribbons, where overhead no longer counts.
    last = {"chain rule": 5, "adjoint": 4, "adjoint, two passes": 3}
    exponents = {
        name: float(np.polyfit(*np.log(a[-last[name] :]).T, 1)[0]) for name, a in arrays.items()
    }
    return Measured(arrays, exponents, apart)


def chained(potential: Potential) -> Objective:
    """The objective of a band with its gradient by the chain rule."""
    space = potential.coordinates

    def objective(z: np.ndarray) -> tuple[float, np.ndarray]:
        shape = space.strip(z)
        table = shape.table
        creases = by_chain_rule(shape, potential.terms.gradient(table))
        full = np.concatenate([np.zeros(6), creases.ravel()])  # its first quad stays
        return potential.terms.energy(table) / potential.unit, space.rows(full) / potential.unit

    return objective


def rest_shapes(segments: tuple[int, ...] = BANDS) -> dict[str, np.ndarray]:
    """Rows (N, seconds, evaluations, energy over D W / l) of the band's rest shape by either gradient."""
    physics, rows = ribbon_physics(), {"chain rule": [], "adjoint": []}
    coarse = closed(BAND, physics)
    for n in segments:
        band, start = refined(BAND, coarse.state, n)
        potential = Setting().potential(band, physics, start)
        program = potential.program(potential.coordinates.pack(start), second=False)
        both = {"chain rule": replace(program, objective=chained(potential)), "adjoint": program}
        for name, one in both.items():
            begin = time.process_time()
            end = augmented(one, Schedule(gradient=1e-4, feasibility=1e-6))
            took = time.process_time() - begin
            rows[name].append((n, took, end.evaluations, end.objective))
    return {name: np.array(made) for name, made in rows.items()}


def complaints(found: Measured, bands: dict[str, np.ndarray] | None = None) -> list[str]:
    chain, ours, passes = found.exponents.values()
    wrong = []
    if found.apart > 1e-10:
        wrong.append(f"gradients differ by {found.apart:.1e}")
    if chain < 1.7:
        wrong.append(f"the chain rule grows with exponent {chain:.2f} only")
    if bands and bands["chain rule"][-1, 1] < bands["adjoint"][-1, 1]:
        wrong.append("the chain rule finds the longest band's rest shape sooner")
    return wrong + [f"an adjoint grows with exponent {e:.2f}" for e in (ours, passes) if e > 1.2]


def draw(found: Measured, bands: dict[str, np.ndarray], path: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 4.2), dpi=110, layout="constrained")
    left, right = figure.subplots(1, 2)
    for name, colour in WAYS.items():
        n, seconds = found.times[name].T
        label = f"{name}: exponent {found.exponents[name]:.2f}"
        left.loglog(n, 1e3 * seconds, "o-", color=colour, label=label)
    left.set(title="one gradient", xlabel="segments", ylabel="ms")
    for name, rows in bands.items():
        right.loglog(rows[:, 0], rows[:, 1], "o-", color=WAYS[name], label=name)
    right.set(title="rest shape of a Moebius band", xlabel="segments", ylabel="s")
    for axes in (left, right):
        axes.grid(alpha=0.3)
        axes.legend(frameon=False)
    figure.savefig(path)


if __name__ == "__main__":
    out, found, bands = folder(__doc__), measure(), rest_shapes()
    draw(found, bands, out / "pan13_gradient_cost.png")
    lines = [
        f"{name}: {', '.join(f'{int(n)}: {1e3 * t:.3g} ms' for n, t in found.times[name])}; "
        f"exponent {found.exponents[name]:.2f}"
        for name in WAYS
    ]
    lines += [
        f"band by {name}, {int(n)} segments: {t:.2f} s, {int(k)} evaluations, energy {e:.5f}"
        for name, rows in bands.items()
        for n, t, k, e in rows
    ]
    conclude([*lines, f"gradients differ by {found.apart:.1e}"], complaints(found, bands))
