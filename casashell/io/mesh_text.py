"""Wavefront OBJ and OFF as text: polygons of any size in file order, coordinates to the last bit.

meshio's readers of these two formats stop at relative (negative) indices, vertex colours, mixed
polygons or OFF quads, and give no line number, so the package reads them itself.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Final

import numpy as np

from casashell.typing import AnyArray, FloatArray

#: Starts of lines of an OBJ file that say nothing about vertices and faces.
_PASSED_OVER: Final = ("#", "vn ", "vt ", "o ", "g ", "s ", "usemtl ", "mtllib ")
_BEHIND_SLASH: Final = re.compile(r"/\S*")


@dataclass(frozen=True)
class PolygonSoup:
    """points: V triples.  polygons: vertex ids from 0.  ignored: other elements by name."""

    points: list[list[float]] | FloatArray
    polygons: list[tuple[int, ...]]
    ignored: dict[str, int]


def read_obj(path: Path) -> PolygonSoup:
    """Vertices and faces of an OBJ file; groups, materials, normals and texture are left out.

    Raises ValueError naming the line.
    """
    plain = _plain_obj(path)
    if plain is not None:
        return plain
    points: list[list[float]] = []
    polygons: list[tuple[int, ...]] = []
    lines: list[int] = []
    ignored: Counter[str] = Counter()
    for number, words in _statements(path):
        try:
            if words[0] == "v":
                points.append(_point(words[1:]))
            elif words[0] in ("f", "fo"):
                polygons.append(_corners(words[1:], len(points)))
                lines.append(number)
            elif words[0] in ("l", "p"):
                ignored["line element" if words[0] == "l" else "point element"] += 1
            elif words[0] in ("curv", "curv2", "surf"):
                ignored["free-form element"] += 1
        except ValueError as problem:
            raise ValueError(f"line {number}: {problem}") from None
    for number, polygon in zip(lines, polygons, strict=True):
        if max(polygon) >= len(points):  # a face may come before its vertices
            raise ValueError(
                f"line {number}: face with vertex {max(polygon) + 1}, "
                f"but the file has only {len(points)} vertices"
            )
    return PolygonSoup(points, polygons, dict(ignored))


def _plain_obj(path: Path) -> PolygonSoup | None:
    """A file of plain vertices and faces, twice as fast; None for anything that needs care.

    Plain: no continued lines, no relative indices, no indices beyond the vertices, no elements but
    faces.  A file with a fault is not plain either: it is read again slowly, which finds the line.
    """
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    if "\\" in text:
        return None
    lines = text.splitlines()
    coordinates = [line[2:].strip() for line in lines if line.startswith("v ")]
    corners = [line[2:].strip() for line in lines if line.startswith("f ")]
    known = sum(line.startswith(_PASSED_OVER) or not line.strip() for line in lines)
    if len(coordinates) + len(corners) + known != len(lines) or not corners:
        return None
    joined = "\n".join(corners)
    if "/" in joined:
        corners = _BEHIND_SLASH.sub("", joined).split("\n")
    points, sizes = _numbers(coordinates, float), [line.count(" ") + 1 for line in corners]
    flat = _numbers(corners, int)
    three = all(line.count(" ") == 2 for line in coordinates)
    if not three or points is None or flat is None or len(points) != 3 * len(coordinates):
        return None
    if len(flat) != sum(sizes) or min(sizes) < 3 or flat.min() < 1 or 3 * flat.max() > len(points):
        return None
    from_zero = iter((flat - 1).tolist())
    polygons = [tuple(islice(from_zero, size)) for size in sizes]
    return PolygonSoup(points.reshape(-1, 3), polygons, {})


def _numbers(lines: list[str], kind: type[float] | type[int]) -> AnyArray | None:
    """All numbers of the lines in one array; None if a word is none."""
    try:
        return np.array(" ".join(lines).split(), dtype=kind)
    except (ValueError, OverflowError):
        return None


def write_obj(path: Path, vertices: FloatArray, polygons: list[tuple[int, ...]]) -> None:
    """Vertices with as many digits as it takes to read back the same doubles; faces as given."""
    with path.open("w", encoding="ascii", newline="\n") as file:
        file.writelines(f"v {x!r} {y!r} {z!r}\n" for x, y, z in vertices.tolist())
        if polygons and len({len(polygon) for polygon in polygons}) == 1:
            row = "f" + " %d" * len(polygons[0]) + "\n"
            file.write(row * len(polygons) % tuple((np.array(polygons) + 1).ravel().tolist()))
        else:
            file.writelines(f"f {' '.join(str(i + 1) for i in p)}\n" for p in polygons)


def read_off(path: Path) -> PolygonSoup:
    """Vertices and faces of an OFF file; colours behind the corners are left out.

    Raises ValueError naming the line.
    """
    lines = _statements(path)
    number, words = next(lines, (1, [""]))
    if words[0] != "OFF":
        raise ValueError(f"line {number}: an OFF file starts with the word OFF")
    try:
        number, words = (number, words[1:]) if len(words) > 1 else next(lines)
        vertex_count, face_count = int(words[0]), int(words[1])
        points, polygons = [], []
        for _ in range(vertex_count):
            number, words = next(lines)
            points.append(_point(words))
        for _ in range(face_count):
            number, words = next(lines)
            polygons.append(_off_corners(words, vertex_count))
    except StopIteration:
        raise ValueError(f"the file ends after line {number}, before its last face") from None
    except (ValueError, IndexError) as problem:
        raise ValueError(f"line {number}: {problem}") from None
    return PolygonSoup(points, polygons, {})


def _statements(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line number and words of every statement: no comments, backslashed lines joined."""
    joined = ""
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        for number, line in enumerate(file, start=1):
            text = line.split("#", 1)[0].rstrip()
            if text.endswith("\\"):
                joined += text[:-1] + " "
                continue
            words = (joined + text).split()
            joined = ""
            if words:
                yield number, words


def _point(words: list[str]) -> list[float]:
    if len(words) < 3:
        raise ValueError(f"a vertex needs three coordinates, found {len(words)}")
    return [float(word) for word in words[:3]]  # a weight or a colour may follow


def _corners(words: list[str], count: int) -> tuple[int, ...]:
    """Vertex ids from 0 of ``v``, ``v/vt``, ``v//vn`` or ``v/vt/vn``; negative: back from here."""
    given = [int(word.split("/", 1)[0]) for word in words]
    if len(given) < 3:
        raise ValueError(f"a face needs three vertices or more, found {len(given)}")
    polygon = tuple(i - 1 if i > 0 else count + i for i in given)
    if min(polygon) < 0 or 0 in given:
        raise ValueError(f"face with vertex {min(given)}, but OBJ counts vertices from 1")
    return polygon


def _off_corners(words: list[str], count: int) -> tuple[int, ...]:
    size = int(words[0])
    if size < 3 or len(words) <= size:
        raise ValueError(f"a face needs three vertices or more, found {' '.join(words)!r}")
    polygon = tuple(map(int, words[1 : size + 1]))
    if min(polygon) < 0 or max(polygon) >= count:
        raise ValueError(f"face with vertices {polygon}, but the file has {count} vertices")
    return polygon
