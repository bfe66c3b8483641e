"""What the report says in words and numbers: certificate, quality, scene, contacts, history."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from casashell.contact.obstacles import MeshObstacle
from casashell.inverse.advice import FREE_FORCE, NEARBY
from casashell.inverse.stability import NEUTRAL
from casashell.io.forces import friction_use
from casashell.io.labels import degrees, engineering, percent
from casashell.result import Result
from casashell.status import Status
from casashell.typing import AnyArray


@dataclass(frozen=True)
class Line:
    """One line of a table.

    name, words    short name; definition in words, may be empty
    value          as shown;  exact  all its digits, may be empty
    wanted         what it has to be, may be empty
    passed         None when nothing is asked of it or it does not apply
    """

    name: str
    words: str
    value: str
    exact: str = ""
    wanted: str = ""
    passed: bool | None = None


def certificate_lines(result: Result) -> tuple[Line, ...]:
    """The proof, one line for each number of the certificate."""
    c = result.certificate
    stiff = None if c.min_eigenvalue_scaled is None else c.min_eigenvalue_scaled > NEUTRAL
    neutral = f"; neutral motions found: {c.neutral_modes}" if c.neutral_modes else ""
    eigenvalue = c.min_eigenvalue
    unknown = "not computed" if c.free_force is None else "no vertex is free"
    return (
        _number(
            "free force",
            "largest component of force left unbalanced at a vertex that is not pinned, "
            "contact forces included, / f0",
            c.free_force,
            f"≤ {_short(FREE_FORCE)}",
            None if c.free_force is None else c.free_force <= FREE_FORCE,
        ),
        _number(
            "least normal force",
            "smallest push of an obstacle on the shell along the contact normal, / f0; "
            "a negative one would pull",
            c.min_normal_force,
            "≥ 0",
            None if c.min_normal_force is None else c.min_normal_force >= 0.0,
            missing="no contacts" if not len(result.contacts) else "not computed",
        ),
        _number(
            "friction in reserve",
            "smallest distance to slipping over all contacts: μ times normal force, less the "
            "tangential force, / f0",
            c.cone_margin,
            "≥ 0",
            None if c.cone_margin is None else c.cone_margin >= 0.0,
            missing="no contacts" if not len(result.contacts) else "not computed",
        ),
        Line(
            "lowest stiffness",
            "smallest eigenvalue of the second derivative of the energy over the vertices that are "
            f"free to move{neutral}",
            unknown if eigenvalue is None else engineering(eigenvalue, "N/m"),
            "" if eigenvalue is None else f"{eigenvalue!r} N/m",
            "> 0",
            stiff,
        ),
        _number(
            "lowest stiffness, scaled",
            f"the same times h / f0; up to {_short(NEUTRAL)} it counts as a neutral motion",
            c.min_eigenvalue_scaled,
            f"> {_short(NEUTRAL)}",
            stiff,
            missing=unknown,
        ),
        _number(
            "distance to target",
            "largest coordinate difference of pose and target, / diagonal of the target's "
            "bounding box",
            c.target_distance,
            f"≤ {_short(NEARBY)}",
            None if c.target_distance is None else c.target_distance <= NEARBY,
        ),
    )


def quality_lines(result: Result) -> tuple[Line, ...]:
    """What the natural shape is like."""
    q = result.quality
    lines = [
        Line("largest stretch", "of an edge, natural against target", percent(q.max_stretch)),
        Line(
            "largest fold",
            "change of a dihedral angle, natural against target",
            f"{degrees(q.max_rest_fold)} ({q.max_rest_fold:.3g} rad)",
        ),
        Line("smallest angle", "of a natural triangle", degrees(q.min_rest_angle)),
        _count("flipped faces", "triangles turned over against the target", q.flipped_faces),
        _count(
            "self-intersections",
            "crossings of an edge with a triangle of the natural shape",
            q.rest_self_intersections,
        ),
    ]
    if q.softest_factor is not None:
        words = "smallest factor on the stiffness at which a natural shape was found"
        lines.append(Line("softest material", words, engineering(q.softest_factor)))
    return tuple(lines)


def key_numbers(result: Result) -> tuple[tuple[str, str], ...]:
    """A few pairs (value, words) for the head of the report."""
    numbers = [
        (f"{len(result.target.vertices):,}".replace(",", "\N{NARROW NO-BREAK SPACE}"), "vertices"),
        (str(len(result.contacts)), "contact" if len(result.contacts) == 1 else "contacts"),
        (percent(result.quality.max_stretch), "largest stretch"),
        (degrees(result.quality.max_rest_fold), "largest fold"),
    ]
    weight = _weight(result)
    if weight is not None and weight > 0:
        numbers.append((engineering(weight, "N"), "weight"))
    numbers.append((engineering(result.seconds, "s"), "solve time"))
    return tuple(numbers)


def scene_lines(result: Result) -> tuple[Line, ...]:
    """Shell, material and loads."""
    mesh, material = result.target, result.material
    size = np.ptp(mesh.vertices[np.unique(mesh.faces)], axis=0)
    polygons = f", {len(mesh.polygons)} polygons" if mesh.polygons else ""
    lines = [
        Line("shell", "", f"{len(mesh.vertices)} vertices, {len(mesh.faces)} triangles{polygons}"),
        Line("size", "", " × ".join(engineering(float(side), "m") for side in size)),
        Line("mean edge length", "h", engineering(result.certificate.h, "m")),
        Line("reference force", "f0, mean weight of a vertex", _f0(result)),
    ]
    for key, words, unit in (
        ("density", "mass per natural area", "kg/m²"),
        ("stretch", "stretching stiffness k_L", "N"),
        ("bend", "bending stiffness k_θ", "J"),
    ):
        if key in material:
            lines.append(Line(key, words, _spread(material[key], unit)))
    gravity = material.get("gravity")
    if gravity is not None:
        vector = ", ".join(f"{float(g):.4g}".replace("-", "\N{MINUS SIGN}") for g in gravity)
        lines.append(Line("gravity", "", f"({vector}) m/s²"))
    if result.contact_tolerance is not None:
        words = "a vertex closer than this to an obstacle is in contact"
        lines.append(Line("contact tolerance", words, engineering(result.contact_tolerance, "m")))
    lines.append(Line("pinned vertices", "", str(len(result.pinned))))
    return tuple(lines)


def contact_rows(result: Result) -> tuple[tuple[str, ...], ...]:
    """Per obstacle: what it is, friction, contacts, total normal force, most friction in use."""
    contacts, forces = result.contacts, result.contact_forces
    normal = np.einsum("ij,ij->i", forces, contacts.normals)
    use = friction_use(forces, contacts.normals, contacts.friction)
    rows = []
    for number, obstacle in enumerate(result.obstacles):
        mine = contacts.obstacle == number
        words = type(obstacle).__name__.replace("MeshObstacle", "mesh").lower()
        if isinstance(obstacle, MeshObstacle):
            words += f", {len(obstacle.mesh.vertices)} vertices"
        most = float(use[mine].max(initial=0.0))
        rows.append(
            (
                obstacle.name or f"obstacle {number}",
                words,
                f"{float(obstacle.friction):g}",
                str(int(mine.sum())),
                engineering(float(normal[mine].sum()), "N"),
                percent(most) if math.isfinite(most) else "beyond the cone",
            )
        )
    return tuple(rows)


def history_rows(result: Result) -> tuple[tuple[str, ...], ...]:
    """stage, load, iteration, residual, seconds, note of every step."""
    return tuple(
        (
            step.stage,
            percent(step.load),
            str(step.iteration),
            engineering(step.residual) if math.isfinite(step.residual) else "\N{EN DASH}",
            engineering(step.seconds, "s"),
            step.note,
        )
        for step in result.history
    )


def tone(status: Status) -> str:
    """green: certified as asked; amber: certified elsewhere, or cut short; red: no."""
    if status is Status.SOLVED:
        return "green"
    return "amber" if status in (Status.SOLVED_NEARBY, Status.INTERRUPTED) else "red"


def _number(
    name: str,
    words: str,
    value: float | None,
    wanted: str,
    passed: bool | None,
    missing: str = "not computed",
) -> Line:
    if value is None:
        return Line(name, words, missing, "", wanted, None)
    return Line(name, words, engineering(value), repr(float(value)), wanted, passed)


def _short(limit: float) -> str:
    """A power of ten as 1e-6, not 1e-06."""
    return f"{limit:.0e}".replace("e-0", "e\N{MINUS SIGN}")


def _count(name: str, words: str, number: int) -> Line:
    return Line(name, words, str(number), wanted="= 0", passed=number == 0)


def _weight(result: Result) -> float | None:
    """Weight of the natural shape [N]; None when the material does not say."""
    density, gravity = result.material.get("density"), result.material.get("gravity")
    if density is None or gravity is None or not np.all(np.isfinite(result.rest)):
        return None
    areas = result.target.moved(result.rest).face_areas
    return float(np.sum(density * areas) * np.linalg.norm(gravity))


def _f0(result: Result) -> str:
    return engineering(result.certificate.f0, "N")


def _spread(values: AnyArray, unit: str) -> str:
    """One value, or least, mean and largest of many."""
    numbers = np.atleast_1d(np.asarray(values, dtype=np.float64))
    if not len(numbers):
        return "none"
    low, high = float(numbers.min()), float(numbers.max())
    if high - low <= 1e-12 * abs(high):
        return f"{high:.4g} {unit}"
    return f"{low:.4g} to {high:.4g} {unit}, mean {float(numbers.mean()):.4g} {unit}"
