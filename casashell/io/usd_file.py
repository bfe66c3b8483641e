"""An animation as USD: time-sampled points, and natural shapes under the names of the deformable schema.

``physics:restShapePoints``, ``physics:restBendAngles`` (degrees), ``physics:restAdjTriPairs`` and
``physics:restBendAnglesDefault`` are the attributes of the surface deformables that the USD physics
working group proposes.  They are authored without applying the schema, which usd-core does not have
yet: importers that know it find them, others ignore them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from casashell.io.animation import Animation, Track
from casashell.io.animation_files import Progress, stems
from casashell.io.colours import OBSTACLE, SHELL
from casashell.io.staging import staged_file
from casashell.typing import AnyArray, FloatArray

_INSTALL: Final = "pip install usd-core, or install casashell with the extra 'usd'"
_SUFFIXES: Final = (".usd", ".usda", ".usdc")
# Width of drawn lines, as a share of the diagonal of all that moves.
_LINE: Final = 0.002


class UsdUnavailable(ImportError):
    """usd-core is not installed; the message says how to get it."""


def write_usd(
    animation: Animation,
    path: Path,
    *,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Path:
    """Write the animation as ``.usd``, ``.usdc`` (binary) or ``.usda`` (text); return the path.

    Every track is a mesh below ``/World`` with points in metres (USD keeps single precision) at
    every frame, or one sample where nothing moves; contact becomes the primvar ``contact``, lines
    become curves.  One time code is one frame.  USD knows only y and z as up: another up axis is
    turned to y by the transform of ``/World``, the points stay in the axes of the input.

    UsdUnavailable (an ImportError): usd-core is missing.  FileExistsError: the file is there and
    ``overwrite`` is False.  ValueError: another extension.
    """
    file = Path(path)
    if file.suffix.lower() not in _SUFFIXES:
        raise ValueError(f"{file}: a USD file ends in {', '.join(_SUFFIXES)}")
    usd = _modules()
    with staged_file(file, overwrite=overwrite) as temporary:
        stage = usd.Usd.Stage.CreateNew(str(temporary))
        _describe(usd, stage, animation)
        codes = time_codes(animation)
        for number, (track, stem) in enumerate(zip(animation.tracks, stems(animation))):
            name = usd.Tf.MakeValidIdentifier(stem.replace("-", "_"))
            place = usd.Sdf.Path("/World").AppendChild(name)
            if stage.GetPrimAtPath(place):  # "a-b" and "a_b" are one identifier
                place = usd.Sdf.Path("/World").AppendChild(f"{name}_{number}")
            _add_mesh(usd, stage, place, track, codes)
            if track.lines is not None and track.lines.shape[1]:
                width = _LINE * float(np.linalg.norm(np.diff(animation.cloud(), axis=0)))
                _add_lines(usd, stage, place, track.lines, codes, width)
            if progress is not None:
                progress(number + 1, len(animation.tracks))
        stage.GetRootLayer().Save()
    return file


def time_codes(animation: Animation) -> FloatArray:
    """Time code (F,) of every frame: whole numbers, from the first time on, where evenly spaced."""
    codes: FloatArray = animation.times * animation.fps
    return np.rint(codes) if animation.even and abs(codes[0] - round(codes[0])) < 1e-6 else codes


def _modules() -> Any:
    """The modules of usd-core; UsdUnavailable without it."""
    try:
        import pxr
        from pxr import Gf, Sdf, Tf, Usd, UsdGeom, Vt  # noqa: F401  (submodules of pxr)
    except ImportError as error:
        raise UsdUnavailable(f"USD files need usd-core ({error}): {_INSTALL}") from error
    return pxr


def _describe(usd: Any, stage: Any, animation: Animation) -> None:
    """Units, axes, rate, range, and the root."""
    geom = usd.UsdGeom
    geom.SetStageMetersPerUnit(stage, 1.0)
    upright = animation.up == (0.0, 0.0, 1.0)
    geom.SetStageUpAxis(stage, geom.Tokens.z if upright else geom.Tokens.y)
    stage.SetTimeCodesPerSecond(animation.fps)
    stage.SetFramesPerSecond(animation.fps)
    codes = time_codes(animation)
    stage.SetStartTimeCode(float(codes[0]))
    stage.SetEndTimeCode(float(codes[-1]))
    stage.SetMetadata("comment", animation.title)
    world = geom.Xform.Define(stage, "/World")
    stage.SetDefaultPrim(world.GetPrim())
    if not upright and animation.up != (0.0, 1.0, 0.0):
        turn = usd.Gf.Rotation(usd.Gf.Vec3d(*animation.up), usd.Gf.Vec3d(0, 1, 0))
        world.AddTransformOp().Set(usd.Gf.Matrix4d().SetRotate(turn))


def _add_mesh(usd: Any, stage: Any, place: Any, track: Track, codes: FloatArray) -> None:
    vt, geom = usd.Vt, usd.UsdGeom
    mesh = geom.Mesh.Define(stage, place)
    mesh.GetPrim().SetDisplayName(track.name)
    mesh.CreateSubdivisionSchemeAttr(geom.Tokens.none)
    mesh.CreateDoubleSidedAttr(True)
    mesh.CreateFaceVertexCountsAttr(vt.IntArray.FromNumpy(_int32(np.full(len(track.faces), 3))))
    mesh.CreateFaceVertexIndicesAttr(vt.IntArray.FromNumpy(_int32(track.faces.ravel())))
    _sample(usd, mesh, mesh.CreatePointsAttr(), track.positions, codes, track.moves)
    colour = OBSTACLE if track.body else SHELL
    rgb = [int(colour[n : n + 2], 16) / 255.0 for n in (1, 3, 5)]
    mesh.CreateDisplayColorAttr([usd.Gf.Vec3f(*(value**2.2 for value in rgb))])
    if track.contact is not None:
        variable = geom.PrimvarsAPI(mesh).CreatePrimvar(
            "contact", usd.Sdf.ValueTypeNames.IntArray, geom.Tokens.vertex
        )
        for code, row in zip(codes, track.contact):
            variable.Set(vt.IntArray.FromNumpy(_int32(row)), float(code))
    _add_rest(usd, mesh.GetPrim(), track)


def _add_rest(usd: Any, prim: Any, track: Track) -> None:
    """Natural shape and angles, as far as the track has them."""
    vt, kinds = usd.Vt, usd.Sdf.ValueTypeNames

    def author(name: str, kind: Any, value: Any) -> None:
        uniform = usd.Sdf.VariabilityUniform
        prim.CreateAttribute(f"physics:{name}", kind, False, uniform).Set(value)

    if track.rest is not None:
        author("restShapePoints", kinds.Point3fArray, vt.Vec3fArray.FromNumpy(_float32(track.rest)))
        triples = vt.Vec3iArray.FromNumpy(_int32(track.faces))
        author("restTriVtxIndices", kinds.Int3Array, triples)
        author("restBendAnglesDefault", kinds.Token, "restShapeDefault")
    if track.rest_angles is not None:
        pairs = vt.Vec2iArray.FromNumpy(_int32(hinge_faces(track)))
        author("restAdjTriPairs", kinds.Int2Array, pairs)
        degrees = vt.FloatArray.FromNumpy(_float32(np.degrees(track.rest_angles)))
        author("restBendAngles", kinds.FloatArray, degrees)


def hinge_faces(track: Track) -> AnyArray:
    """(H,2) the two faces at each hinge: that of corner k, then that of corner l."""
    hinges = track.mesh.hinges
    triangle = {tuple(sorted(face)): number for number, face in enumerate(track.faces.tolist())}
    sides = [
        [triangle[tuple(sorted((i, j, corner)))] for corner in (k, far)]
        for i, j, k, far in hinges.tolist()
    ]
    return np.array(sides, dtype=np.int64).reshape(-1, 2)


def _add_lines(
    usd: Any, stage: Any, place: Any, lines: FloatArray, codes: FloatArray, width: float
) -> None:
    vt, geom = usd.Vt, usd.UsdGeom
    curves = geom.BasisCurves.Define(
        stage, place.GetParentPath().AppendChild(place.name + "_lines")
    )
    curves.CreateTypeAttr(geom.Tokens.linear)
    curves.CreateCurveVertexCountsAttr(vt.IntArray(lines.shape[1], 2))
    curves.CreateWidthsAttr([width])
    curves.SetWidthsInterpolation(geom.Tokens.constant)
    points = lines.reshape(len(lines), -1, 3)
    _sample(usd, curves, curves.CreatePointsAttr(), points, codes, True)


def _sample(
    usd: Any, shape: Any, attribute: Any, frames: FloatArray, codes: FloatArray, moves: bool
) -> None:
    """Points and extent at every time code, or once without a time."""
    extent = shape.CreateExtentAttr()
    for code, points in zip(codes if moves else codes[:1], frames):
        when = usd.Usd.TimeCode(float(code)) if moves else usd.Usd.TimeCode.Default()
        single = _float32(points)
        attribute.Set(usd.Vt.Vec3fArray.FromNumpy(single), when)
        box = np.stack([single.min(axis=0), single.max(axis=0)])
        extent.Set(usd.Vt.Vec3fArray.FromNumpy(box), when)


def _float32(values: AnyArray) -> AnyArray:
    return np.ascontiguousarray(values, dtype=np.float32)


def _int32(values: AnyArray) -> AnyArray:
    return np.ascontiguousarray(values, dtype=np.int32)
