"""What a ribbon is, and where it is."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, TypeAlias, get_args

import numpy as np

from casashell.typing import ArrayLike, BoolArray, FloatArray

BendingEnergy: TypeAlias = Literal["sadowsky", "wunderlich"]
Ends: TypeAlias = Literal["clamped", "free", "loop", "moebius"]

#: Largest bending angle of a crease [rad]: a strip does not fold onto itself.
MOST_BENT = math.pi - 0.1
#: A Moebius band of paper is longer than this times its width (Schwartz 2023).
SHORTEST_MOEBIUS = math.sqrt(3.0)


@dataclass(frozen=True, eq=False)
class Ribbon:
    """An inextensible strip, ``length`` x ``width`` [m] when flat, in ``segments`` quads (Pan 2016).

    stiffness      D [J], the plate modulus E h^3 / (12 (1 - nu^2)); the paper's k is 2 D
    density        rho [kg/m2]
    ends           "clamped": the first quad is held, "free": neither end, "loop" and "moebius": the
                   ends are joined
    energy         "sadowsky" (the paper) or "wunderlich" (curvature varies along a ruling)
    margin         shortest edge between two rulings on a rim, as a part of a segment's length
    rest_angles    natural bending angles of the inner creases [rad], (N-1,) or one number
    regulariser    m of  m D W / (2 L^2) integral c^2 ds: prefers rulings across the centreline
    target_rulings slopes which the rulings prefer (N-1,), instead of zero in the regulariser
    clamp_crease   a crease at the very beginning, for the half segment that the paper's creases leave
                   rigid: makes what is clamped there converge with order two
    end_crease     the same at the end, for ends held there
    rest_start, rest_end  natural angles of these two creases [rad]

    Raises ValueError for sizes, weights and angles that make no ribbon.
    """

    length: float
    width: float
    segments: int
    stiffness: float = 1.0
    density: float = 1.0
    ends: Ends = "clamped"
    energy: BendingEnergy = "sadowsky"
    margin: float = 0.1
    rest_angles: ArrayLike = 0.0
    regulariser: float = 1e-3
    target_rulings: ArrayLike = 0.0
    clamp_crease: bool = False
    end_crease: bool = False
    rest_start: float = 0.0
    rest_end: float = 0.0

    def __post_init__(self) -> None:
        self._check_sizes()
        if self.energy not in get_args(BendingEnergy):
            raise ValueError(f"energy must be 'sadowsky' or 'wunderlich', got {self.energy!r}")
        if self.ends not in get_args(Ends):
            raise ValueError(f"ends must be one of {', '.join(get_args(Ends))}; got {self.ends!r}")
        if self.ends in ("loop", "moebius") and (self.clamp_crease or self.end_crease):
            raise ValueError("a closed ribbon has no clamped ends: leave out clamp and end crease")
        if self.ends == "moebius" and self.length <= SHORTEST_MOEBIUS * self.width:
            raise ValueError(
                f"a Moebius band needs length / width > sqrt(3) = 1.732, got "
                f"{self.length / self.width:.4g}: make it longer or narrower"
            )
        if self.ends in ("loop", "moebius") and self.segments < 4:
            raise ValueError(f"a closed ribbon needs at least 4 segments, got {self.segments}")
        angles = _per_crease("rest_angles", self.rest_angles, self.segments)
        _refuse("rest_angles", np.abs(angles) > MOST_BENT, angles, f"within {MOST_BENT:.3f} rad")
        object.__setattr__(self, "rest_angles", angles)
        for name, present in (("rest_start", self.clamp_crease), ("rest_end", self.end_crease)):
            angle = getattr(self, name)
            if not abs(angle) <= MOST_BENT or (angle != 0.0 and not present):
                raise ValueError(
                    f"{name} is {angle:g}: within {MOST_BENT:.3f}, and 0 without a crease"
                )
        rulings = _per_crease("target_rulings", self.target_rulings, self.segments)
        if np.any(rulings):
            self.require_rulings(rulings, "target_rulings")
        object.__setattr__(self, "target_rulings", rulings)

    def _check_sizes(self) -> None:
        if int(self.segments) != self.segments or self.segments < 2:
            raise ValueError(f"segments must be a whole number >= 2, got {self.segments}")
        for name in ("length", "width", "stiffness", "density"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} must be a finite number > 0, got {value}")
        if not 0 < self.margin < 1:
            raise ValueError(f"margin must be within 0 and 1, got {self.margin}")
        if not (math.isfinite(self.regulariser) and self.regulariser >= 0):
            raise ValueError(f"regulariser must be finite and >= 0, got {self.regulariser}")

    @property
    def segment(self) -> float:
        """l [m], length of a quad."""
        return self.length / self.segments

    @property
    def most_turn(self) -> float:
        """Largest change of slope between neighbouring rulings that keeps them from crossing."""
        return 2.0 * self.segment * (1.0 - self.margin) / self.width

    @property
    def closed(self) -> bool:
        """True for a loop or Moebius band."""
        return self.ends in ("loop", "moebius")

    @property
    def bends(self) -> BoolArray:
        """(N+1,) true where the strip bends: at the inner stations and at the extra creases."""
        here = np.ones(self.segments + 1, dtype=np.bool_)
        here[0], here[-1] = self.clamp_crease, self.end_crease
        return here

    @property
    def energy_unit(self) -> float:
        """D W / l [J]: what energies are divided by inside of solvers."""
        return self.stiffness * self.width / self.segment

    def require_rulings(self, slopes: FloatArray, name: str = "slopes") -> None:
        """Raise ValueError when neighbouring rulings with these slopes (N-1,) cross."""
        turn = np.diff(np.concatenate([[0.0], slopes, [0.0]]))
        crossing = np.flatnonzero(np.abs(turn) >= 2.0 * self.segment / self.width)
        if crossing.size:
            e = int(crossing[0])
            raise ValueError(
                f"{name}: rulings {e} and {e + 1} cross within the strip: their slopes differ by "
                f"{turn[e]:.4g}, at most {2.0 * self.segment / self.width:.4g} is possible (the ends "
                "have slope 0); use a smoother field, a narrower strip or longer segments"
            )


def _per_crease(name: str, value: ArrayLike, segments: int) -> FloatArray:
    given = np.array(value, dtype=np.float64)
    if given.ndim > 0 and given.shape != (segments - 1,):
        raise ValueError(
            f"{name} must be a number or one value per inner crease, shape ({segments - 1},); "
            f"got shape {given.shape}"
        )
    spread = np.array(np.broadcast_to(given, (segments - 1,)))
    _refuse(name, ~np.isfinite(spread), spread, "finite")
    return spread


def _refuse(name: str, wrong: BoolArray, values: FloatArray, wanted: str) -> None:
    if np.any(wrong):
        at = int(np.flatnonzero(wrong)[0])
        raise ValueError(f"{name} of crease {at + 1} must be {wanted}, got {values[at]:g}")


@dataclass(frozen=True, eq=False)
class RibbonState:
    """Where a ribbon is: a point of its developable configurations.

    slopes        c (N-1,), cotangents of the angles between inner rulings and centreline
    angles        beta (N-1,) [rad], bending across the inner rulings
    frame         (3,3) rotation: axes of the first quad (along, across, normal) in its columns
    origin        (3,) [m], begin of the centreline
    start_angle, end_angle  across the clamp and end creases [rad], 0 without them

    Raises ValueError for shapes that do not fit, numbers that are not finite and a frame that is not
    a rotation.  Crossing rulings are refused by `checked`, which knows the ribbon.
    """

    slopes: FloatArray
    angles: FloatArray
    frame: FloatArray = field(default_factory=lambda: np.eye(3))
    origin: FloatArray = field(default_factory=lambda: np.zeros(3))
    start_angle: float = 0.0
    end_angle: float = 0.0

    def __post_init__(self) -> None:
        for name in ("slopes", "angles", "frame", "origin"):
            value = np.array(getattr(self, name), dtype=np.float64)
            if not np.all(np.isfinite(value)):
                raise ValueError(f"{name} of a ribbon must be finite")
            object.__setattr__(self, name, value)
        if self.slopes.ndim != 1 or self.slopes.shape != self.angles.shape:
            raise ValueError(
                f"slopes and angles must have one shape (N-1,), got {self.slopes.shape} "
                f"and {self.angles.shape}"
            )
        if self.frame.shape != (3, 3) or self.origin.shape != (3,):
            raise ValueError("frame must have shape (3, 3) and origin (3,)")
        off = np.abs(self.frame.T @ self.frame - np.eye(3)).max()
        if off > 1e-9 or np.linalg.det(self.frame) < 0:
            raise ValueError(f"frame must be a rotation; its columns are orthonormal to {off:.1e}")
        if not (math.isfinite(self.start_angle) and math.isfinite(self.end_angle)):
            raise ValueError("start_angle and end_angle must be finite")

    @property
    def segments(self) -> int:
        """N."""
        return len(self.slopes) + 1

    @cached_property
    def all_slopes(self) -> FloatArray:
        """(N+1,) with the ends, which are 0."""
        return np.concatenate([[0.0], self.slopes, [0.0]])

    @cached_property
    def all_angles(self) -> FloatArray:
        """(N+1,) with the clamp and end crease."""
        return np.concatenate([[self.start_angle], self.angles, [self.end_angle]])

    def checked(self, ribbon: Ribbon) -> RibbonState:
        """Itself; ValueError when it is no state of ``ribbon``."""
        if self.segments != ribbon.segments:
            raise ValueError(
                f"the state has {self.segments} segments, the ribbon {ribbon.segments}"
            )
        ribbon.require_rulings(self.slopes)
        _refuse("angles", np.abs(self.angles) > MOST_BENT, self.angles, f"within {MOST_BENT:.3f}")
        extra = (
            ("start_angle", self.start_angle, ribbon.clamp_crease, "clamp_crease"),
            ("end_angle", self.end_angle, ribbon.end_crease, "end_crease"),
        )
        for name, angle, present, crease in extra:
            if angle != 0.0 and not present:
                raise ValueError(f"{name} is {angle:g}, but the ribbon has no {crease}")
        return self


def flat(ribbon: Ribbon) -> RibbonState:
    """The ribbon flat in the plane z = 0, its centreline on the x axis."""
    zeros = np.zeros(ribbon.segments - 1)
    return RibbonState(zeros, zeros)


def uncrossed(ribbon: Ribbon, slopes: FloatArray) -> FloatArray:
    """Slopes (N-1,) near the given ones whose rulings keep the ribbon's margin.

    The largest function below them that nowhere turns too fast, cut to what the ends allow.
    """
    turn = 0.999 * ribbon.most_turn
    at = np.arange(1, ribbon.segments)
    apart = turn * np.abs(at[:, None] - at[None, :])
    reach = turn * np.minimum(at, ribbon.segments - at)
    return np.asarray(np.clip((slopes[None, :] + apart).min(axis=1), -reach, reach))
