"""A result as a folder of files, and back.

natural.obj, pose.obj, target.obj  positions in the input's own unit, its faces and vertex order
nearest.obj                        in place of natural.obj when the natural shape is a metric that no
                                   mesh has: the mesh nearest to it, for pictures only
metric.npz                         natural lengths, angles and areas in SI, when they were asked for
result.json                        status, advice, certificate, quality, history
result.npz                         arrays in SI, input axes
scene.toml, obstacle-N.obj         enough to run again
vertex_map.txt                     where repair put each vertex of the input, if it did
"""

from __future__ import annotations

import dataclasses
import json
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np

from casashell.contact.detect import Contacts
from casashell.io.obstacle_tables import KINDS, read_obstacle
from casashell.io.scene_file import TARGET_FILE, write_scene
from casashell.io.staging import staged
from casashell.io.toml_tables import read_toml
from casashell.mesh import TriMesh
from casashell.metric import Metric
from casashell.result import Certificate, Quality, Result, Step
from casashell.status import Status
from casashell.typing import AnyArray, FloatArray, IntArray

PICTURES: Final = ("target", "forces", "natural", "compare", "stretch", "bending", "overview")
REPORT_FILE: Final = "report.html"
_OWNED: Final = frozenset(
    {
        *(
            "natural.obj",
            "nearest.obj",
            "pose.obj",
            TARGET_FILE,
            "result.json",
            "result.npz",
            "metric.npz",
        ),
        *("scene.toml", "vertex_map.txt", REPORT_FILE),
        *(f"{name}.png" for name in PICTURES),
    }
)
_MATERIAL: Final = (
    *("edges", "hinges", "stretch", "bend", "density", "gravity"),
    "vertex_friction",  # (V,), only where the shell has friction of its own
)

#: Arrays of metric.npz.
METRIC_KEYS: Final = ("edges", "rest_length", "hinges", "rest_angle", "rest_area")

_Record = TypeVar("_Record", Certificate, Quality, Step)


def owned(name: str) -> bool:
    """True for the names of files that belong to a result."""
    return name in _OWNED or re.fullmatch(r"obstacle-\d+\.obj", name) is not None


def save_result(
    result: Result,
    folder: str | Path,
    *,
    unit: float = 1.0,
    name: str = "",
    overwrite: bool = False,
    vertex_map: IntArray | None = None,
) -> tuple[str, ...]:
    """Write the files of a result; the folder appears complete or not at all.

    unit        metres per unit of the mesh files and of scene.toml
    name        what scene.toml calls the scene
    overwrite   replace the result in a folder that is not empty; files of other names stay
    vertex_map  (V_input,) new number of every vertex of the input, -1 if dropped

    Returns the names of the files.  Raises FileExistsError for a folder with files and no
    ``overwrite``, OSError for what the file system refuses, ValueError for a wrong unit.
    """
    if not (math.isfinite(unit) and unit > 0.0):
        raise ValueError(f"unit must be metres per unit, > 0, got {unit}")
    target = Path(folder)
    with staged(target, overwrite=overwrite, owned=owned, last="result.json") as folder_now:
        _write_meshes(result, folder_now, unit)
        arrays: dict[str, Any] = dict(arrays_of(result))
        np.savez(folder_now / "result.npz", **arrays)
        if result.metric is not None:
            metric: dict[str, Any] = dict(metric_arrays(result.metric))
            np.savez(folder_now / "metric.npz", **metric)
        write_scene(result, folder_now, unit=unit, name=name)
        if vertex_map is not None:
            _write_vertex_map(vertex_map, folder_now / "vertex_map.txt")
        text = json.dumps(record_of(result, unit), indent=1, allow_nan=False)
        (folder_now / "result.json").write_text(text + "\n", encoding="utf-8")
        names = tuple(sorted(item.name for item in folder_now.iterdir()))
    return names


def load_result(folder: str | Path) -> Result:
    """The result saved in a folder.

    Raises ValueError for a folder that holds no (complete) result, OSError for unreadable files.
    """
    source = Path(folder)
    if not (source / "result.json").is_file() or not (source / "result.npz").is_file():
        raise ValueError(f"{source} holds no result: result.json or result.npz is missing")
    try:
        record = json.loads((source / "result.json").read_text(encoding="utf-8"))
        with np.load(source / "result.npz", allow_pickle=False) as file:
            arrays = {key: file[key] for key in file.files}
        return _restored(source, record, arrays)
    except (KeyError, TypeError, AttributeError, ValueError) as problem:
        raise ValueError(f"{source} holds no readable result: {problem}") from problem


def record_of(result: Result, unit: float = 1.0) -> dict[str, Any]:
    """What result.json says; numbers that are not finite become null."""
    record = {
        "status": str(result.status),
        "advice": result.advice,
        "method": result.method,
        "natural": result.natural,
        "seconds": result.seconds,
        "vertices": len(result.target.vertices),
        "contacts": len(result.contacts),
        "iterations": result.iterations,
        "factorizations": result.factorizations,
        "certificate": dataclasses.asdict(result.certificate),
        "quality": dataclasses.asdict(result.quality),
        "unit": unit,
        "contact_tolerance": result.contact_tolerance,
        "notes": list(result.notes),
        "timings": dict(result.timings),
        "history": [_line(step) for step in result.history],
    }
    plain: dict[str, Any] = _plain(record)
    return plain


def arrays_of(result: Result) -> dict[str, AnyArray]:
    """What result.npz holds; keys, types and shapes are part of the interface."""
    mesh, contacts = result.target, result.contacts
    arrays: dict[str, AnyArray] = {
        "rest": _floats(result.rest),
        "pose": _floats(result.pose),
        "target": _floats(mesh.vertices),
        "faces": _ints(mesh.faces),
        "edges": _ints(mesh.edges),
        "hinges": _ints(mesh.hinges),
        "contacts": _ints(contacts.vertices),
        "normals": _floats(contacts.normals).reshape(-1, 3),
        "friction": _floats(contacts.friction),
        "gaps": _floats(contacts.gaps),
        "obstacle": _ints(contacts.obstacle),
        "contact_forces": _floats(result.contact_forces).reshape(-1, 3),
        "forces": _floats(result.forces),
        "pinned": _ints(result.pinned),
    }
    for key in _MATERIAL[2:]:
        if key in result.material:
            arrays[key] = _floats(result.material[key])
    return arrays


def metric_arrays(metric: Metric) -> dict[str, AnyArray]:
    """What metric.npz holds."""
    return {
        "edges": _ints(metric.edges),
        "rest_length": _floats(metric.rest_length),
        "hinges": _ints(metric.hinges),
        "rest_angle": _floats(metric.rest_angle),
        "rest_area": _floats(metric.rest_area),
    }


def _write_meshes(result: Result, folder: Path, unit: float) -> None:
    from casashell.io.meshes import write_mesh

    label = f"status {result.status}"
    if not result.status.certified:
        label += ", not certified: a partial result"
    natural = "natural" if result.natural == "mesh" else "nearest"
    for name, positions in ((natural, result.rest), ("pose", result.pose)):
        if not np.isfinite(positions).all():
            continue  # a computation that broke down has no shape to show
        path = folder / f"{name}.obj"
        write_mesh(path, result.target, positions, unit=unit)
        text = path.read_text(encoding="utf-8")
        if name == "nearest":
            label += "; NOT the natural shape, which is metric.npz: only the mesh nearest to it"
        path.write_text(f"# casashell: {name} shape, {label}\n{text}", encoding="utf-8")


def _write_vertex_map(vertex_map: IntArray, path: Path) -> None:
    lines = ["# vertex of the input -> vertex of the files here, counted from 0; -1: dropped"]
    lines += [f"{old} {new}" for old, new in enumerate(vertex_map.tolist())]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _plain(value: Any) -> Any:
    """Dictionaries, lists, text and finite numbers."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _floats(values: Any) -> FloatArray:
    return np.ascontiguousarray(values, dtype=np.float64).reshape(np.shape(values))


def _ints(values: Any) -> IntArray:
    return np.ascontiguousarray(values, dtype=np.int64)


def _restored(folder: Path, record: Mapping[str, Any], arrays: Mapping[str, AnyArray]) -> Result:
    target, obstacles, notes = _scene(folder, record, arrays)
    return Result(
        status=Status(record["status"]),
        advice=record["advice"],
        method=record["method"],
        target=target,
        rest=arrays["rest"],
        pose=arrays["pose"],
        contacts=Contacts(
            arrays["contacts"],
            arrays["normals"],
            arrays["friction"],
            arrays["gaps"],
            arrays["obstacle"],
        ),
        pinned=arrays["pinned"],
        contact_forces=arrays["contact_forces"],
        forces=arrays["forces"],
        material={key: arrays[key] for key in _MATERIAL if key in arrays},
        certificate=_record(Certificate, record["certificate"]),
        quality=_record(Quality, record["quality"]),
        obstacles=obstacles,
        history=tuple(_record(Step, step) for step in record["history"]),
        notes=(*record["notes"], *notes),
        seconds=record["seconds"],
        iterations=record["iterations"],
        factorizations=record["factorizations"],
        timings=record["timings"],
        contact_tolerance=record["contact_tolerance"],
        metric=_metric(folder, record.get("natural", "mesh")),
    )


def _metric(folder: Path, natural: str) -> Metric | None:
    """The metric saved beside a result, if one was."""
    path = folder / "metric.npz"
    if not path.is_file():
        if natural == "metric":
            raise ValueError("metric.npz is missing, which is the natural shape of this result")
        return None
    with np.load(path, allow_pickle=False) as file:
        return Metric(**{key: file[key] for key in METRIC_KEYS}, embedded=natural == "mesh")


def _scene(
    folder: Path, record: Mapping[str, Any], arrays: Mapping[str, AnyArray]
) -> tuple[TriMesh, tuple[Any, ...], tuple[str, ...]]:
    """Target with the input's polygons, obstacles, and what could not be restored."""
    from casashell.io.meshes import read_mesh

    unit = float(record["unit"])
    polygons = read_mesh(folder / TARGET_FILE, unit=unit).polygons
    target = TriMesh(arrays["target"], arrays["faces"], polygons)
    tables = read_toml(folder / "scene.toml").get("obstacle", [])
    known = ("mesh", *KINDS)
    if any(table["kind"] not in known for table in tables):
        return target, (), ("obstacles of a class of its own are not restored from files",)
    obstacles = tuple(
        read_obstacle(table, f"{folder / 'scene.toml'}, obstacle {number}", folder, unit)
        for number, table in enumerate(tables, start=1)
    )
    return target, obstacles, ()


def _line(step: Step) -> dict[str, object]:
    """A step without the shapes that only callbacks see."""
    shapes = ("rest", "pose")
    names = [field.name for field in dataclasses.fields(step) if field.name not in shapes]
    return {name: getattr(step, name) for name in names}


def _record(kind: type[_Record], values: Mapping[str, Any]) -> _Record:
    """A record from its JSON form: null is NaN where the field must be a number."""
    given: dict[str, Any] = {
        entry.name: math.nan
        if values[entry.name] is None and entry.type == "float"
        else values[entry.name]
        for entry in dataclasses.fields(kind)
        if entry.name in values
    }
    return kind(**given)
