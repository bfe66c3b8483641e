"""The ``[[ribbon]]`` tables of a scene file, see `casashell.app.ribbon_reader`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, TypeVar, get_args

import numpy as np

from casashell.app.keyframe_files import read_keyframes
from casashell.app.ribbon_setup import Actions, Course, Hold, Load, Twist, carried, end_of
from casashell.app.ribbon_shapes import frame_of, placed, wound
from casashell.app.values import ArrayReference, parse_material
from casashell.io.toml_tables import Table, is_number
from casashell.ribbon.bands import closed
from casashell.ribbon.chain import reconstruct
from casashell.ribbon.forces import material
from casashell.ribbon.loops import circle
from casashell.ribbon.physics import RibbonPhysics
from casashell.ribbon.ribbon import BendingEnergy, Ends, Ribbon, RibbonState, flat
from casashell.ribbon.scene import Body, Guide, require_size
from casashell.ribbon.statics import Junction
from casashell.typing import FloatArray

_NUMBERS: Final = ("length", "width", "stiffness", "density", "margin", "regulariser")
_FIELDS: Final = ("rest_angles", "target_rulings")
_FLAGS: Final = ("clamp_crease", "end_crease")
_WORDS: Final = {"ends": get_args(Ends), "energy": get_args(BendingEnergy)}
_RIBBON: Final = (
    *("name", "segments", "junction", *_NUMBERS, *_FIELDS, *_FLAGS, *_WORDS),
    *("start", "begin", "end", "attachment", "load", "guide"),
)
#: Keys that each shape of a start needs, beside those which may be left out.
_SHAPES: Final = {
    "flat": (),
    "helix": ("radius",),
    "circle": (),
    "moebius": (),
    "arrays": ("file",),
}
_START: Final = (
    *("shape", "radius", "slope", "file", "origin", "centre", "along", "across"),
    *("velocity", "spin"),
)
#: Weight of a guide, in D W / L, unless given.
GUIDED: Final = 1e3

_Made = TypeVar("_Made")


@contextmanager
def _at(where: str) -> Iterator[None]:
    """A ValueError of the block gets ``where`` in front, unless it has it."""
    try:
        yield
    except ValueError as problem:
        text = str(problem)
        raise ValueError(text if text.startswith(where) else f"{where}: {text}") from None


def read_body(values: Any, where: str, folder: Path, number: int, physics: RibbonPhysics) -> Body:
    """One ribbon; ValueError naming table and key, OSError for files that cannot be opened."""
    table = Table.checked(values, where, _RIBBON)
    with _at(where):
        ribbon = _ribbon(table, folder)
        require_size(ribbon)
    begin, end = (_motion(table, key, folder) for key in ("begin", "end"))
    start = Table.checked(table.values.get("start", {}), f"{where}, [ribbon.start]", _START)
    with _at(start.where):
        state = _state(start, ribbon, folder, physics)
        state.checked(ribbon)
    actions = Actions(
        holds=_all(table, "attachment", lambda entry: _hold(entry, ribbon, state)),
        loads=_all(table, "load", lambda entry: _load(entry, ribbon)),
        end=None if end is None else (*end_of(ribbon, state), end[0]),
        junction=_junction(table),
    )
    motion = None if begin is None else begin[0]
    with _at(where):
        return Body(
            ribbon,
            state,
            actions,
            begin=None if motion is None else carried(state, motion),
            guides=_all(table, "guide", lambda entry: _guide(entry, ribbon, state)),
            velocity=start.vector("velocity") if "velocity" in start else (0.0, 0.0, 0.0),
            spin=start.vector("spin") if "spin" in start else (0.0, 0.0, 0.0),
            name=table.text("name", f"ribbon {number}"),
        )


def _ribbon(table: Table, folder: Path) -> Ribbon:
    table.require("length", "width", "segments")
    given: dict[str, Any] = {key: table.number(key) for key in _NUMBERS if key in table}
    given |= {key: table.flag(key) for key in _FLAGS if key in table}
    given |= {key: table.choice(key, known, "") for key, known in _WORDS.items() if key in table}
    for key in _FIELDS:
        if key in table:
            value = parse_material(table.values[key], f"{table.where}: {key}", folder)
            given[key] = value.read() if isinstance(value, ArrayReference) else value
    if type(table.values["segments"]) is not int:
        raise table.wrong("segments", "a whole number")
    return Ribbon(segments=table.values["segments"], **given)


def _junction(table: Table) -> Junction | None:
    if "junction" not in table:
        return None
    if table.text("ends") not in ("loop", "moebius"):
        raise ValueError(f'{table.where}: junction is for ends = "loop" or "moebius"')
    return "flat" if table.choice("junction", get_args(Junction), "") == "flat" else "crease"


def _motion(table: Table, key: str, folder: Path) -> tuple[Any] | None:
    """The motion of a held begin or end, which may be none at all; None without the table."""
    if key not in table:
        return None
    entry = Table.checked(table.values[key], f"{table.where}, [ribbon.{key}]", ("motion",))
    if key == "begin":
        entry.require("motion")
    if "motion" not in entry:
        return (None,)
    return (read_keyframes(folder / entry.text("motion"), 1.0),)


def _state(start: Table, ribbon: Ribbon, folder: Path, physics: RibbonPhysics) -> RibbonState:
    """Shape and place."""
    usual = {"loop": "circle", "moebius": "moebius"}.get(ribbon.ends, "flat")
    shape = start.choice("shape", tuple(_SHAPES), usual)
    start.require(*_SHAPES[shape])
    for key, kind in (("radius", "helix"), ("slope", "helix"), ("file", "arrays")):
        if key in start and shape != kind:
            raise ValueError(f'{start.where}: {key} is for shape = "{kind}", this is "{shape}"')
    if (shape == "circle") != (ribbon.ends == "loop") and shape != "arrays":
        raise ValueError(f'a {shape} is no start for ends = "{ribbon.ends}"')
    if (shape == "moebius") != (ribbon.ends == "moebius") and shape != "arrays":
        raise ValueError(f'a {shape} is no start for ends = "{ribbon.ends}"')
    if "origin" in start and "centre" in start:
        raise ValueError(f"{start.where}: give origin or centre, not both")
    if shape == "arrays":
        state = _arrays(folder / start.text("file"), ribbon)
        if not any(key in start for key in ("origin", "centre", "along", "across")):
            return state
    else:
        state = _formed(shape, start, ribbon, physics)
    along = start.vector("along") if "along" in start else tuple(state.frame[:, 0])
    across = start.vector("across") if "across" in start else tuple(state.frame[:, 1])
    place = {key: start.vector(key) for key in ("origin", "centre") if key in start}
    return placed(ribbon, state, frame_of(along, across), **place)


def _formed(shape: str, start: Table, ribbon: Ribbon, physics: RibbonPhysics) -> RibbonState:
    if shape == "helix":
        slope = start.number("slope") if "slope" in start else 0.0
        return wound(ribbon, start.number("radius"), slope)
    if shape == "circle":
        return circle(ribbon)
    if shape == "moebius":
        return resting_band(ribbon, physics)
    return flat(ribbon)


def resting_band(ribbon: Ribbon, physics: RibbonPhysics) -> RibbonState:
    """The Moebius band at rest without gravity; ValueError when none is found."""
    found = closed(ribbon, physics)
    if not found.converged:
        raise ValueError(
            f"no Moebius band of length / width {ribbon.length / ribbon.width:.3g} with "
            f"{ribbon.segments} segments was found: take more segments, or a longer or narrower strip"
        )
    return found.state


def _arrays(path: Path, ribbon: Ribbon) -> RibbonState:
    made: dict[str, Any] = {key: ArrayReference(path, key).read() for key in ("slopes", "angles")}
    with np.load(path, allow_pickle=False) as file:
        made |= {key: file[key] for key in ("frame", "origin") if key in file}
    try:
        return RibbonState(**made).checked(ribbon)
    except ValueError as problem:
        raise ValueError(f"{path}: {problem}") from None


def _all(table: Table, key: str, read: Callable[[Table], _Made]) -> tuple[_Made, ...]:
    """All tables ``[[ribbon.key]]`` of a ribbon."""
    entries = table.values.get(key, [])
    if not isinstance(entries, list):
        raise ValueError(f"{table.where}: write every {key} under [[ribbon.{key}]]")
    made = []
    for number, values in enumerate(entries):
        entry = Table.checked(values, f"{table.where}, {key} {number}", _KEYS[key])
        with _at(entry.where):
            made.append(read(entry))
    return tuple(made)


_KEYS: Final = {
    "attachment": ("s", "y", "place", "times", "places", "moves", "until"),
    "load": ("s", "y", "force", "times", "forces"),
    "guide": ("segments", "normal", "axis", "times", "turns", "weight"),
}


def _hold(entry: Table, ribbon: Ribbon, state: RibbonState) -> Hold:
    s, y = _point(entry, ribbon)
    here = _place(ribbon, state, s, y)
    until = entry.number("until") if "until" in entry else np.inf
    if "moves" in entry:
        if "place" in entry or "places" in entry:
            raise ValueError("give moves, place or places, only one of them")
        moves = _keyframes(entry, "moves")
        return Hold(s, y, Course(moves.times, here + np.asarray(moves.values)), until)
    return Hold(s, y, _course(entry, "place", "places", Course.constant(here)), until)


def _load(entry: Table, ribbon: Ribbon) -> Load:
    return Load(*_point(entry, ribbon), _course(entry, "force", "forces", None))


def _guide(entry: Table, ribbon: Ribbon, state: RibbonState) -> Guide:
    entry.require("segments")
    which = entry.whole_numbers("segments")
    if not which or min(which) < 0 or max(which) >= ribbon.segments:
        raise ValueError(f"segments must be some of 0 .. {ribbon.segments - 1}")
    weight = GUIDED * ribbon.stiffness * ribbon.width / ribbon.length
    weight = entry.number("weight") if "weight" in entry else weight
    normal = reconstruct(ribbon, state).normals[which[0]]
    if "normal" in entry:
        given = np.array(entry.vector("normal"))
        if not np.linalg.norm(given) > 0:
            raise ValueError("normal has no direction")
        normal = given / np.linalg.norm(given)
    if "axis" not in entry and "turns" not in entry and "times" not in entry:
        return Guide(which, normal, weight)
    entry.require("axis", "turns", "times")
    axis = np.array(entry.vector("axis"))
    if not np.linalg.norm(axis) > 0:
        raise ValueError("axis has no direction")
    turns = Course(_list(entry, "times"), _list(entry, "turns"))
    return Guide(which, Twist(normal, axis, turns), weight)


def _point(entry: Table, ribbon: Ribbon) -> tuple[float, float]:
    entry.require("s")
    s, y = entry.number("s"), entry.number("y") if "y" in entry else 0.0
    material(ribbon, s, y)  # refuses a point outside of the strip
    return s, y


def _place(ribbon: Ribbon, state: RibbonState, s: float, y: float) -> FloatArray:
    """Where a material point is."""
    shape = reconstruct(ribbon, state)
    quad = material(ribbon, s, y, state.all_slopes)[0]
    frame = shape.behind[quad]
    ahead = s - quad * ribbon.segment
    return np.asarray(shape.middle[quad] + ahead * frame[:, 0] + y * frame[:, 1])


def _course(entry: Table, one: str, many: str, usual: Course | None) -> Course:
    """A vector, or keyframes of vectors."""
    if one in entry and (many in entry or "times" in entry):
        raise ValueError(f"give {one}, or times and {many}, not both")
    if one in entry:
        return Course.constant(entry.vector(one))
    if many in entry or "times" in entry:
        return _keyframes(entry, many)
    if usual is None:
        raise ValueError(f"{one} is missing")
    return usual


def _keyframes(entry: Table, key: str) -> Course:
    """The vectors of ``key`` at the times of ``times``."""
    entry.require("times", key)
    rows = entry.values[key]
    if not isinstance(rows, list):
        raise entry.wrong(key, "a list of three numbers a time")
    return Course(
        _list(entry, "times"), [Table({key: row}, entry.where).vector(key) for row in rows]
    )


def _list(entry: Table, key: str) -> Sequence[float]:
    value = entry.values.get(key)
    if not isinstance(value, list) or not all(map(is_number, value)):
        raise entry.wrong(key, "a list of numbers")
    return [float(item) for item in value]
