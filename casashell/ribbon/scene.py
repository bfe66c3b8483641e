"""Several ribbons and what acts on them over time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from casashell.contact.obstacles import Obstacle
from casashell.ribbon import forces
from casashell.ribbon.chain import Strip, reconstruct
from casashell.ribbon.physics import RibbonPhysics
from casashell.ribbon.ribbon import Ribbon, RibbonState, flat
from casashell.ribbon.statics import Setting
from casashell.ribbon.terms import Term
from casashell.typing import ArrayLike, FloatArray

#: Most quads of a ribbon that moves: a step needs several matrices of 2 N x 2 N numbers, 288 MB each.
MOST_SEGMENTS = 3000
#: Frame (3,3) and origin (3,) of a first quad at a time [s].
Pose: TypeAlias = Callable[[float], tuple[ArrayLike, ArrayLike]]
#: Positions (2,N+1,3) of all ribbons before and after a step -> the latter without interpenetration.
Collide: TypeAlias = Callable[[Sequence[FloatArray], Sequence[FloatArray]], Sequence[FloatArray]]


@dataclass(frozen=True, eq=False)
class Guide:
    """The normals of ``segments`` are drawn to ``normal``: (3,), or a function of time [s].

    weight  k of k/2 |n - nstar|^2 [J].  Turn nstar by less than a right angle in a step
    """

    segments: tuple[int, ...]
    normal: ArrayLike | Callable[[float], ArrayLike]
    weight: float

    def term(self, ribbon: Ribbon, physics: RibbonPhysics, t: float) -> Term:
        """The energy at time t."""
        normal = self.normal(t) if callable(self.normal) else self.normal
        return forces.guiding(ribbon, physics, self.segments, normal, self.weight)


@dataclass(frozen=True, eq=False)
class Body:
    """One ribbon of a scene.

    start     where it is at t = 0; flat by default
    setting   attachments, a held end, loads and energies beside the scene's gravity; a function of
              time [s] where they move: attachments that move drag the ribbon
    begin     frame and origin of a clamped ribbon's first quad over time; where it starts by default
    guides    normals that are drawn to directions
    velocity  (3,) [m/s] and ``spin`` (3,) [rad/s] about the centre of mass, at t = 0
    """

    ribbon: Ribbon
    start: RibbonState | None = None
    setting: Setting | Callable[[float], Setting] = field(default_factory=Setting)
    begin: Pose | None = None
    guides: tuple[Guide, ...] = ()
    velocity: ArrayLike = (0.0, 0.0, 0.0)
    spin: ArrayLike = (0.0, 0.0, 0.0)
    name: str = ""

    def __post_init__(self) -> None:
        state = flat(self.ribbon) if self.start is None else self.start.checked(self.ribbon)
        object.__setattr__(self, "start", state)
        for name in ("velocity", "spin"):
            object.__setattr__(self, name, forces.vector(name, getattr(self, name)))
        if self.begin is not None and self.ribbon.ends != "clamped":
            raise ValueError(f"begin is the way of a clamped end, this one is {self.ribbon.ends}")
        if self.ribbon.ends == "clamped" and (np.any(self.velocity) or np.any(self.spin)):
            raise ValueError("a clamped ribbon starts at rest: its motion is that of its begin")

    @property
    def initial(self) -> RibbonState:
        """The state at t = 0."""
        if self.start is None:
            raise ValueError("a body without start")
        return self.start

    def at(self, t: float, gravity: FloatArray) -> Setting:
        """What acts at time t, the scene's gravity included."""
        setting = self.setting(t) if callable(self.setting) else self.setting
        total = np.asarray(setting.gravity, dtype=np.float64) + gravity
        return replace(setting, gravity=total)

    def terms(self, t: float, physics: RibbonPhysics) -> tuple[Term, ...]:
        """Guides at time t."""
        return tuple(guide.term(self.ribbon, physics, t) for guide in self.guides)

    def pose(self, t: float) -> tuple[FloatArray, FloatArray] | None:
        """Frame and origin of the first quad at time t; None for a ribbon that is not clamped."""
        if self.ribbon.ends != "clamped":
            return None
        if self.begin is None:
            return self.initial.frame, self.initial.origin
        frame, origin = self.begin(t)
        return np.asarray(frame, dtype=np.float64), forces.vector("origin of the begin", origin)

    def velocities(self, shape: Strip) -> FloatArray:
        """(2,N+1,3) [m/s] of the vertices at t = 0."""
        points = np.stack([shape.bottom, shape.top])
        away = points - centre_of_mass(self.ribbon, points, self.initial.all_slopes)
        made: FloatArray = np.asarray(self.velocity) + np.cross(np.asarray(self.spin), away)
        return made


def require_size(ribbon: Ribbon) -> None:
    """ValueError for a ribbon of more segments than a step has memory for."""
    if ribbon.segments > MOST_SEGMENTS:
        raise ValueError(
            f"segments is {ribbon.segments}, a step of more than {MOST_SEGMENTS} has no room in "
            "memory: take fewer segments"
        )


def vertex_masses(ribbon: Ribbon, slopes: FloatArray) -> FloatArray:
    """(2,N+1) [kg] row sums of the consistent mass on rulings with ``slopes`` (N+1,)."""
    run = 0.5 * ribbon.width * np.diff(slopes)
    below, above = ribbon.segment - run, ribbon.segment + run
    share = ribbon.density * ribbon.width / 12.0
    made = np.zeros((2, ribbon.segments + 1))
    for row, mass in zip(made, (share * (2 * below + above), share * (below + 2 * above))):
        row[:-1] += mass
        row[1:] += mass
    return made


def centre_of_mass(ribbon: Ribbon, points: FloatArray, slopes: FloatArray) -> FloatArray:
    """(3,) [m] of vertices (2,N+1,3)."""
    mass = vertex_masses(ribbon, slopes)
    centre: FloatArray = np.einsum("ri,ria->a", mass, points) / mass.sum()
    return centre


@dataclass(frozen=True, eq=False)
class Scene:
    """Ribbons, gravity [m/s2] and contact.

    physics    from ``formulations.ribbon_physics()``
    thickness  [m] for collisions between ribbons, of a ribbon with itself and with ``obstacles``;
               0: no collisions
    collide    own response instead: positions (2,N+1,3) of all ribbons before and after a step ->
               the latter without interpenetration
    Raises ValueError for what cannot work at t = 0.
    """

    bodies: tuple[Body, ...]
    physics: RibbonPhysics
    gravity: ArrayLike = (0.0, 0.0, -9.81)
    thickness: float = 0.0
    obstacles: tuple[Obstacle, ...] = ()
    collide: Collide | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "bodies", tuple(self.bodies))
        object.__setattr__(self, "gravity", forces.vector("gravity", self.gravity))
        if not self.bodies:
            raise ValueError("a scene needs at least one ribbon")
        if not (np.isfinite(self.thickness) and self.thickness >= 0):
            raise ValueError(f"thickness must be finite and >= 0, got {self.thickness}")
        if self.obstacles and self.thickness == 0 and self.collide is None:
            raise ValueError("obstacles need a thickness of the ribbons: give one above 0")
        for number, body in enumerate(self.bodies):
            try:
                self._check(body)
            except ValueError as error:
                label = body.name or f"ribbon {number}"
                raise ValueError(f"{label}: {error}") from error

    def _check(self, body: Body) -> None:
        require_size(body.ribbon)
        if self.thickness > body.ribbon.width:
            raise ValueError(
                f"thickness is {self.thickness:g} m, more than the strip's width of "
                f"{body.ribbon.width:g} m: take a smaller thickness"
            )
        setting = body.at(0.0, np.asarray(self.gravity))
        slopes = body.initial.all_slopes
        setting.potential(body.ribbon, self.physics, body.initial, slopes=slopes)
        body.terms(0.0, self.physics)
        reconstruct(body.ribbon, body.initial)

    def response(self) -> Collide | None:
        """The collision response of this scene."""
        if self.collide is not None or self.thickness == 0:
            return self.collide
        from casashell.ribbon.contact import strip_collisions

        return strip_collisions(self.bodies, self.thickness, self.obstacles)
