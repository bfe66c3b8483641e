"""Wavefront OBJ and OFF as text: polygons of any size in file order, coordinates to the last bit.

meshio's readers of these two formats stop at relative (negative) indices, vertex colours, mixed
polygons or OFF quads, and give no line number, so the package reads them itself.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from casashell.typing import FloatArray


@dataclass(frozen=True)
class PolygonSoup:
    """points: V triples.  polygons: vertex ids from 0.  ignored: other elements by name."""

    points: list[list[float]]
    polygons: list[tuple[int, ...]]
    ignored: dict[str, int]


def read_obj(path: Path) -> PolygonSoup:
    """Vertices and faces of an OBJ file; groups, materials, normals and texture are left out.

    Raises ValueError naming the line.
    """
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


def write_obj(path: Path, vertices: FloatArray, polygons: list[tuple[int, ...]]) -> None:
    """Vertices with as many digits as it takes to read back the same doubles; faces as given."""
    with path.open("w", encoding="ascii", newline="\n") as file:
        file.writelines(f"v {x!r} {y!r} {z!r}\n" for x, y, z in vertices.tolist())
        file.writelines(f"f {' '.join(str(i + 1) for i in polygon)}\n" for polygon in polygons)


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
