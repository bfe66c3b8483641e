"""What a simulation is made of, checked before the first step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from casashell.contact.detect import Contacts
from casashell.contact.obstacles import Obstacle
from casashell.dynamics.bodies import Body, RestingBody
from casashell.dynamics.motion import Motion
from casashell.dynamics.touching import Watch
from casashell.engine.energy import Energy
from casashell.engine.kernels import get_kernel
from casashell.mesh import TriMesh
from casashell.metric import laid_out, with_metric
from casashell.problem import DEFAULT_TOLERANCE, Problem
from casashell.result import Result
from casashell.typing import AnyArray, ArrayLike, FloatArray, IntArray

#: Natural shapes a simulation may start from.
RESTS = ("natural", "target")
#: Depth, in the target's bounding box diagonal, that counts as deep inside a body.
DEEP = 0.02
#: Acceleration [m/s2] that makes masses into forces where tolerances are relative to weight.
STANDARD_GRAVITY = 9.81


@dataclass(frozen=True, eq=False)
class Setting:
    """Shell, start and contacts of a simulation.

    start, rest  (V,3) m;  mass (V,) kg;  forces (B,V,3) N a first guess of contact forces
    """

    target: TriMesh
    energies: tuple[Energy, ...]
    start: FloatArray
    rest: FloatArray
    mass: FloatArray
    pinned: IntArray
    obstacles: tuple[Obstacle, ...]
    contacts: Contacts
    friction: AnyArray | None
    forces: FloatArray

    @property
    def weight(self) -> float:
        """Mean nodal weight [N] that residuals are relative to."""
        return STANDARD_GRAVITY * float(self.mass.mean())

    @property
    def diagonal(self) -> float:
        """Diagonal of the target's bounding box [m]."""
        return float(self.target.bbox_diagonal)


def setting_of(
    result: Result, problem: Problem | None, rest: str | ArrayLike, mass: ArrayLike | None
) -> Setting:
    """Everything but bodies in motion; ValueError naming what is missing or does not fit."""
    target = result.target
    if problem is not None:
        _check_same(result, problem)
    energies = result.energies if problem is None else problem.energies
    if not energies:
        raise ValueError(
            "this result carries no energies, as results read from files do not: give the problem "
            "it was solved for, problem=..."
        )
    obstacles: tuple[Obstacle, ...] = result.obstacles if problem is None else problem.obstacles
    friction = result.material.get("vertex_friction") if problem is None else problem.friction
    if len(result.contacts) and not obstacles:
        raise ValueError(
            "this result has contacts but no obstacles, as with obstacles of a class of their own "
            "that were read from files: give the problem it was solved for, problem=..."
        )
    natural = isinstance(rest, str) and rest == "natural"
    shape, areas = target.vertices if not natural else result.rest, None
    if not isinstance(rest, str):
        shape = _shape(rest, len(target.vertices))
    elif rest not in RESTS:
        raise ValueError(f"rest must be one of {', '.join(RESTS)} or positions (V,3); got '{rest}'")
    elif natural and result.metric is not None and not result.metric.embedded:
        energies = with_metric(energies, target, laid_out(target, result.metric))
        areas = result.metric.rest_area
    shape = _shape(shape, len(target.vertices))
    start = _finite(result.pose, "pose of the result") if natural else target.vertices
    forces = np.zeros((len(obstacles), len(start), 3))
    if natural and np.isfinite(result.contact_forces).all():
        forces[result.contacts.obstacle, result.contacts.vertices] = result.contact_forces
    made = _masses(target, energies, result, shape, areas) if mass is None else _given(mass, target)
    return Setting(
        target=target,
        energies=tuple(energies),
        start=np.array(start),
        rest=shape,
        mass=made,
        pinned=np.asarray(result.pinned, dtype=np.int64),
        obstacles=tuple(obstacles),
        contacts=result.contacts,
        friction=None if friction is None else np.asarray(friction),
        forces=forces,
    )


def in_motion(term: Energy, x: FloatArray, r: FloatArray, *, interpreted: bool = False) -> Energy:
    """The term with its density for motions, unless the stiffness of the start is another.

    A start that is crushed would not hold then; a natural triangle without area has no slopes at all.
    """
    if term.in_motion is None:
        return term
    made = replace(term, density=term.in_motion)
    x, r = (np.ascontiguousarray(points, dtype=np.float64) for points in (x, r))
    plain, moving = (
        get_kernel(each.density, "hessian", interpreted=interpreted)(
            x, r, each.params, each.stencils, x
        )
        for each in (term, made)
    )
    stiffness, other = plain[-1], moving[-1]
    least = 1e-9 * float(np.abs(stiffness).max(initial=0.0))
    same = np.allclose(stiffness, other, rtol=1e-9, atol=least) and np.isfinite(moving[0]).all()
    return made if same else term


def _check_same(result: Result, problem: Problem) -> None:
    mesh, other = result.target, problem.target
    if not np.array_equal(mesh.faces, other.faces):
        raise ValueError("the problem has another mesh than the result: their faces differ")
    away = float(np.abs(mesh.vertices - other.vertices).max())
    if away > 1e-9 * float(mesh.bbox_diagonal):
        raise ValueError(
            f"the problem has another target than the result: vertices differ by {away:.3g} m"
        )
    if not np.array_equal(np.asarray(problem.pinned), result.pinned):
        raise ValueError("the problem pins other vertices than the result")
    wrong = result.contacts.obstacle[result.contacts.obstacle >= len(problem.obstacles)]
    if wrong.size:
        raise ValueError(f"the result touches obstacle {int(wrong[0])}, the problem has fewer")


def _shape(rest: ArrayLike, count: int) -> FloatArray:
    shape = np.ascontiguousarray(rest, dtype=np.float64)
    if shape.shape != (count, 3):
        raise ValueError(
            f"rest must have one position a vertex of the target, shape ({count}, 3), "
            f"got {shape.shape}"
        )
    return _finite(shape, "rest")


def _finite(points: FloatArray, what: str) -> FloatArray:
    wrong = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if wrong.size:
        raise ValueError(f"{what}: vertex {int(wrong[0])} is not finite")
    return np.ascontiguousarray(points, dtype=np.float64)


def _masses(
    target: TriMesh,
    energies: Sequence[Energy],
    result: Result,
    rest: FloatArray,
    areas: FloatArray | None,
) -> FloatArray:
    """Lumped masses (V,) kg: a third of density times natural area of the faces around a vertex."""
    known = [term.material["density"] for term in energies if "density" in term.material]
    known += [result.material["density"]] if "density" in result.material else []
    if not known:
        raise ValueError(
            "no energy of the problem tells a density [kg/m2] in its material, so the shell has no "
            "mass: add area_gravity (gravity may be zero) or give mass=, kg for every vertex"
        )
    share = np.asarray(known[0]) * (target.moved(rest).face_areas if areas is None else areas) / 3.0
    made = np.bincount(target.faces.ravel(), np.repeat(share, 3), minlength=len(target.vertices))
    return _moving(np.asarray(made, dtype=np.float64))


def _given(mass: ArrayLike, target: TriMesh) -> FloatArray:
    count = len(target.vertices)
    made = np.array(np.broadcast_to(np.asarray(mass, dtype=np.float64), (count,)))
    wrong = np.flatnonzero(~(np.isfinite(made) & (made >= 0.0)))
    if wrong.size:
        raise ValueError(f"mass of vertex {int(wrong[0])} must be finite and >= 0 kg")
    return _moving(made)


def _moving(mass: FloatArray) -> FloatArray:
    if not mass.any():
        raise ValueError("the shell has no mass: its density is zero everywhere")
    return mass


Motions = Motion | Mapping[int | str, Motion] | None


def bodies_of(obstacles: Sequence[Obstacle], motion: Motions, seconds: float) -> tuple[Body, ...]:
    """Obstacles, those in motion bound to it; ValueError naming the obstacle that does not exist.

    motion  one for all obstacles, or by their number or name
    """
    chosen: dict[int, Motion] = {}
    if isinstance(motion, Mapping):
        names = {entry.name: k for k, entry in enumerate(obstacles) if entry.name}
        for key, value in motion.items():
            number = names.get(key, -1) if isinstance(key, str) else int(key)
            if not 0 <= number < len(obstacles):
                known = ", ".join([*map(str, range(len(obstacles))), *names]) or "none"
                raise ValueError(f"motion names obstacle {key!r}; the scene has: {known}")
            chosen[number] = value
    elif motion is not None:
        if not obstacles:
            raise ValueError("there is a motion but no obstacle to move")
        chosen = dict.fromkeys(range(len(obstacles)), motion)
    for value in chosen.values():
        if not isinstance(value, Motion):
            raise ValueError(
                f"a motion needs a bind method, {type(value).__name__} has none; see RigidMotion"
            )
    return tuple(
        chosen[k].bind(entry, k, seconds) if k in chosen else RestingBody(entry, k)
        for k, entry in enumerate(obstacles)
    )


def watches_of(setting: Setting, bodies: Sequence[Body]) -> list[Watch]:
    """Offsets and friction of every vertex with every body.

    A vertex keeps the gap at which the target touched that obstacle, or any; vertices that touched
    nothing have the median of all gaps, or zero where that is negative.
    """
    count, contacts = len(setting.start), setting.contacts
    usual = max(float(np.median(contacts.gaps)), 0.0) if len(contacts) else 0.0
    own = np.full(count, np.inf)
    np.minimum.at(own, contacts.vertices, contacts.gaps)
    own[np.isinf(own)] = usual
    allowed = np.ones(count, dtype=bool)
    allowed[setting.pinned] = False
    watches = []
    for body in bodies:
        offset = own.copy()
        mine = contacts.obstacle == body.number
        offset[contacts.vertices[mine]] = contacts.gaps[mine]
        mu = np.full(count, body.obstacle.friction)
        if setting.friction is not None:
            mu = np.asarray(setting.friction, dtype=np.float64)
        watches.append(Watch(body, mu, offset, allowed))
    return watches


def check_start(setting: Setting, watches: Sequence[Watch], tolerance: float | None) -> None:
    """ValueError naming the vertex that starts deepest, when it starts deep inside a body."""
    limit = max(DEEP * setting.diagonal, tolerance or DEFAULT_TOLERANCE * setting.diagonal)
    for watch in watches:
        ids = np.flatnonzero(watch.allowed)
        gap, _ = watch.body.signed_distance(setting.start[ids], 0.0)
        if len(ids) and gap.min() < -limit:
            vertex = int(ids[np.argmin(gap)])
            label = watch.body.obstacle.name or f"obstacle {watch.body.number}"
            raise ValueError(
                f"vertex {vertex} starts {-gap.min():.3g} m deep inside {label}; a simulation must "
                f"start outside (at most {limit:.3g} m deep): move the shell, or check units and axes"
            )
