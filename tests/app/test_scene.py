"""Scene files: what they may say, what is refused, and results that run again."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from casashell import solve
from casashell.app.builtin import skirt
from casashell.app.scene import Scene, SceneSpec
from casashell.app.scene_reader import read_scene
from casashell.app.values import parse_pins, read_pins
from casashell.contact.obstacles import Capsule, Cone, Cylinder, MeshObstacle, Plane, Sphere
from casashell.io.meshes import write_mesh
from casashell.io.results import save_result
from casashell.mesh import TriMesh
from casashell.status import Status

FULL = """
name = "leaf"
method = "direct"
gravity = 1.62
tolerance = 0.5
pinned = [3, 1]

[shell]
file = "page.obj"
unit = "cm"
up = "z"

[material]
density = 1
stretch = 2.5
bend = "values.npz:stiffness"

[[obstacle]]
kind = "plane"
name = "desk"
normal = [0.0, 0.0, 2.0]
offset = -4.0
friction = 0.25

[[obstacle]]
kind = "sphere"
center = [0.0, 0.0, -100.0]
radius = 50.0

[[obstacle]]
kind = "cylinder"
base = [0.0, 0.0, -200.0]
axis = [1.0, 0.0, 0.0]
radius = 10

[[obstacle]]
kind = "cone"
apex = [0.0, 0.0, -300.0]
axis = [0.0, 0.0, -1.0]
half_angle = 0.5
length = 20.0

[[obstacle]]
kind = "capsule"
a = [0.0, 0.0, -400.0]
b = [1.0, 0.0, -400.0]
radius = 3.0

[[obstacle]]
file = "block.obj"
friction = 0.75
flip = true
"""


@pytest.fixture
def folder(page_file: Path, quads: TriMesh) -> Path:
    """page.obj, values.npz and an inside-out tetrahedron block.obj, in cm."""
    path = page_file.parent
    np.savez(path / "values.npz", stiffness=np.full(len(quads.hinges), 2e-3))
    text = "v 0 0 -500\nv 1 0 -500\nv 0 1 -500\nv 0 0 -499\nf 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3\n"
    (path / "block.obj").write_text(text)
    return path


def read(folder: Path, text: str) -> SceneSpec:
    (folder / "scene.toml").write_text(text)
    return read_scene(folder / "scene.toml")


def test_a_file_that_says_everything(folder: Path, quads: TriMesh, tmp_path_factory: Any) -> None:
    spec = read(folder, FULL)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("elsewhere"))  # paths are relative to the file
        scene = spec.load()
    assert (scene.name, scene.method, scene.up, scene.unit) == ("leaf", "direct", "z", 0.01)
    assert scene.gravity == (0.0, 0.0, -1.62)
    assert scene.tolerance == pytest.approx(0.005)
    assert scene.pinned == (3, 1)
    np.testing.assert_allclose(scene.target.vertices, quads.vertices, atol=1e-15)
    assert (scene.material.density, scene.material.stretch) == (1.0, 2.5)
    np.testing.assert_array_equal(scene.material.bend, np.full(len(quads.hinges), 2e-3))
    desk, ball, pipe, spike, pill, block = scene.obstacles
    assert desk == Plane((0.0, 0.0, 1.0), -0.02, 0.25, "desk")
    assert ball == Sphere((0.0, 0.0, -1.0), 0.5, 0.5, "sphere")
    assert pipe == Cylinder((0.0, 0.0, -2.0), (1.0, 0.0, 0.0), 0.1, None, 0.5, "cylinder")
    assert isinstance(spike, Cone)
    assert (spike.half_angle, spike.length) == (0.5, pytest.approx(0.2))
    assert pill == Capsule((0.0, 0.0, -4.0), (0.01, 0.0, -4.0), 0.03, 0.5, "capsule")
    assert isinstance(block, MeshObstacle)
    assert (block.name, block.friction, block.flip, block.closed) == ("block", 0.75, True, True)
    assert set(spec.inputs) == {
        folder / name for name in ("page.obj", "block.obj", "values.npz", "scene.toml")
    }


def test_defaults_are_those_of_the_options(folder: Path) -> None:
    scene = read(folder, '[shell]\nfile = "page.obj"\n').load()
    plain = SceneSpec(folder / "page.obj").load()
    for given in (scene, plain):
        material = given.material
        assert (material.density, material.stretch, material.bend) == (0.2, 20.0, 1e-3)
        assert (given.gravity, given.unit, given.up) == ((0.0, -9.81, 0.0), 1.0, "y")
        assert (given.tolerance, given.pinned, given.obstacles) == (None, (), ())
        assert (given.method, given.name) == ("auto", "page")


def test_gravity_as_a_vector_and_pins_from_a_file(folder: Path) -> None:
    (folder / "pins.txt").write_text("# corners\n0\n5  # and the other\n\n36, 41\n")
    scene = read(
        folder, 'gravity = [1, 0, -9]\npinned = "pins.txt"\n[shell]\nfile = "page.obj"\n'
    ).load()
    assert scene.gravity == (1.0, 0.0, -9.0)
    assert scene.pinned == (0, 5, 36, 41)
    assert scene.up_vector == (-1.0, 0.0, 9.0)
    assert scene.weight == pytest.approx(scene.mass * math.hypot(1.0, 9.0))


def test_pins_as_a_list_or_a_path() -> None:
    assert parse_pins("3,17, 42") == (3, 17, 42)
    assert parse_pins("7") == (7,)
    assert parse_pins("pins.txt") == Path("pins.txt")


def test_files_may_begin_with_a_byte_order_mark(tmp_path: Path) -> None:
    pins, scene = tmp_path / "pins.txt", tmp_path / "scene.toml"
    pins.write_text("3\n17\n", encoding="utf-8-sig", newline="\r\n")
    scene.write_text('[shell]\nfile = "page.obj"\n', encoding="utf-8-sig")
    assert read_pins(pins) == (3, 17)
    assert read_scene(scene).shell == tmp_path / "page.obj"


SHELL = '[shell]\nfile = "page.obj"\n'
WRONG = {
    "no shell": ("gravity = 1.0\n", "shell is missing"),
    "no file": ("[shell]\n", "file is missing"),
    "misspelt table": (SHELL + "[materials]\n", "did you mean 'material'"),
    "misspelt key": ('[shell]\nfile = "page.obj"\nunits = "m"\n', "did you mean 'unit'"),
    "text for a number": (SHELL + '[material]\nbend = "soft"\n', "bend must be a finite number"),
    "true for a number": (SHELL + "[material]\nbend = true\n", "bend must be a finite number"),
    "infinite": (SHELL + "[material]\nbend = inf\n", "bend must be a finite number"),
    "number for a file": ("[shell]\nfile = 3\n", "file must be text"),
    "shell as text": ('shell = "page.obj"\n', "must be a table"),
    "wrong unit": ('[shell]\nfile = "page.obj"\nunit = "ft"\n', "unit"),
    "wrong method": ('method = "magic"\n' + SHELL, "auto, direct"),
    "gravity of two": ("gravity = [0, 1]\n" + SHELL, "three"),
    "pins with fractions": ("pinned = [1.5]\n" + SHELL, "whole numbers"),
    "obstacle in single brackets": (SHELL + '[obstacle]\nkind = "plane"\n', r"\[\[obstacle\]\]"),
    "obstacle without kind": (SHELL + "[[obstacle]]\nradius = 1\n", "obstacle 1: kind is missing"),
    "kind misspelt": (SHELL + '[[obstacle]]\nkind = "spere"\n', "did you mean 'sphere'"),
    "sphere without radius": (
        SHELL + '[[obstacle]]\nkind = "sphere"\ncenter = [0, 0, 0]\n',
        "radius is missing",
    ),
    "key of another kind": (
        SHELL + '[[obstacle]]\nkind = "plane"\nnormal = [0, 0, 1]\noffset = 0\nradius = 1\n',
        "unknown key 'radius'",
    ),
    "normal of two": (SHELL + '[[obstacle]]\nkind = "plane"\nnormal = [0, 1]\noffset = 0\n', "thr"),
    "radius below zero": (
        SHELL + '[[obstacle]]\nkind = "sphere"\ncenter = [0, 0, 0]\nradius = -1\n',
        "obstacle 1: Sphere radius",
    ),
    "inside-out block": (SHELL + '[[obstacle]]\nfile = "block.obj"\n', "block.obj"),
    "missing array": (SHELL + '[material]\nbend = "values.npz:bend"\n', "stiffness"),
    "not an npz file": (SHELL + '[material]\nbend = "text.npz:bend"\n', "not an npz file"),
    "too few values": (SHELL + '[material]\nstretch = "values.npz:stiffness"\n', "per edge"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_refused(folder: Path, name: str) -> None:
    text, message = WRONG[name]
    (folder / "text.npz").write_text("no zip file")
    with pytest.raises(ValueError, match=message):
        _ = read(folder, text).load().problem


def test_missing_files(folder: Path) -> None:
    with pytest.raises(OSError, match=r"none\.npz"):
        read(folder, SHELL + '[material]\nbend = "none.npz:bend"\n').load()
    with pytest.raises(OSError, match=r"pins\.txt"):
        read(folder, 'pinned = "pins.txt"\n' + SHELL).load()
    with pytest.raises(ValueError, match=r"none\.obj"):
        read(folder, '[shell]\nfile = "none.obj"\n').load()


def test_a_pin_dropped_by_repair_names_itself(folder: Path) -> None:
    (folder / "loose.obj").write_text("v 9 9 9\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 2 3 4\n")
    spec = SceneSpec(folder / "loose.obj", pinned=(1, 3))
    scene = spec.load(repair=True)
    assert scene.pinned == (0, 2)
    assert scene.vertex_map is not None
    assert scene.vertex_map.tolist() == [-1, 0, 1, 2]
    with pytest.raises(ValueError, match="pinned vertex 0 was dropped"):
        replace(spec, pinned=(0,)).load(repair=True)


def test_a_saved_result_runs_again(folder: Path, quads: TriMesh) -> None:
    """Values per element, two obstacles with friction of their own, pins, dm, z up."""
    random = np.random.default_rng(1)
    write_mesh(folder / "page_dm.obj", quads, unit=0.1)
    floor = [(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0), (0, 0, -9)]
    slab = TriMesh(
        0.1 * np.array(floor, dtype=float),
        np.array([(0, 1, 2), (0, 2, 3), (1, 0, 4), (2, 1, 4), (3, 2, 4), (0, 3, 4)]),
    )
    write_mesh(folder / "slab.obj", slab, unit=0.1)
    np.savez(
        folder / "material.npz",
        density=random.uniform(9, 11, len(quads.faces)),
        stretch=random.uniform(5, 6, len(quads.edges)),
        bend=random.uniform(2e-3, 3e-3, len(quads.hinges)),
    )
    values = "".join(f'{key} = "material.npz:{key}"\n' for key in ("density", "stretch", "bend"))
    spec = read(
        folder,
        "tolerance = 0.0001\npinned = [0, 5]\n"
        '[shell]\nfile = "page_dm.obj"\nunit = "dm"\nup = "z"\n'
        f"[material]\n{values}"
        '[[obstacle]]\nfile = "slab.obj"\nfriction = 0.45\n'
        '[[obstacle]]\nkind = "plane"\nnormal = [0, 0, 1]\noffset = 0\nfriction = 0.35\n',
    )
    first, again = _solved_and_again(spec.load(), folder)
    assert first.status is again.status is Status.SOLVED
    assert len(first.contacts) == 20  # ten unpinned vertices on both obstacles
    assert (set(again.contacts.friction), again.pinned.tolist()) == ({0.35, 0.45}, [0, 5])
    for key in ("density", "stretch", "bend", "gravity"):
        np.testing.assert_array_equal(again.material[key], first.material[key])
    assert again.target.polygons == first.target.polygons == quads.polygons
    # the certificate's tolerance on forces is 1e-6; positions repeat to rounding
    np.testing.assert_allclose(again.rest, first.rest, atol=1e-9 * quads.bbox_diagonal)
    np.testing.assert_allclose(again.contact_forces, first.contact_forces, atol=1e-7)


def _solved_and_again(scene: Scene, folder: Path) -> tuple[Any, Any]:
    result = replace(solve(scene.problem), contact_tolerance=scene.problem.tolerance)
    save_result(result, folder / "out", unit=scene.unit)
    second = read_scene(folder / "out" / "scene.toml").load()
    return result, solve(second.problem, second.method)


def test_friction_of_the_shell_itself_survives_a_round_trip(tmp_path: Path) -> None:
    scene = skirt(6, 20)
    count = len(scene.target.vertices)
    grip = np.linspace(0.4, 0.9, count)
    scene = replace(scene, material=replace(scene.material, friction=grip))
    result = solve(scene.problem)
    np.testing.assert_array_equal(result.contacts.friction, grip[result.contacts.vertices])
    result.save(tmp_path / "out")
    again = read_scene(tmp_path / "out" / "scene.toml").load().problem.contacts
    np.testing.assert_array_equal(again.friction, result.contacts.friction)


def test_friction_of_a_vertex_must_be_a_number() -> None:
    scene = skirt(6, 20)
    grip = np.full(len(scene.target.vertices), 0.5)
    grip[7] = np.nan
    with pytest.raises(ValueError, match="friction of vertex 7"):
        _ = replace(scene, material=replace(scene.material, friction=grip)).problem
    with pytest.raises(ValueError, match="one value per vertex"):
        _ = replace(scene, material=replace(scene.material, friction=grip[:-1])).problem
