"""Scripts that go with exported files; they run inside the simulators, not here."""

from __future__ import annotations

from typing import Final

NEWTON_SCRIPT: Final = '''\
"""Puts the natural metric of newton.npz into a Newton model made with add_cloth_mesh.

    arrays = np.load("newton.npz")
    builder.add_cloth_mesh(vertices=arrays["pose"], indices=arrays["tri_indices"].ravel(), ...)
    model = builder.finalize()
    apply(model, arrays)          # first_particle, first_triangle: where this cloth begins

Written for the arrays of Newton 1.x: edge_indices (o0, o1, v0, v1), tri_poses, tri_areas.  The masses of
the particles were made from the pose; particle_mass wants rest areas times density / 3 a corner.
"""

import numpy as np


def apply(model, arrays, first_particle=0, first_triangle=0):
    key = {tuple(row): at for at, row in enumerate(np.sort(arrays["edge_indices"][:, 2:], 1).tolist())}
    rows = model.edge_indices.numpy().reshape(-1, 4) - first_particle
    angle, length = model.edge_rest_angle.numpy(), model.edge_rest_length.numpy()
    for at, row in enumerate(rows.tolist()):
        found = key.get(tuple(sorted(row[2:])))
        if found is None or min(row[:2]) < 0:
            continue
        here = arrays["edge_indices"][found].tolist()
        # Both ends and both sides exchanged is the same element; one of the two alone is not.
        same = (row[0] == here[0]) == (row[2] == here[2])
        angle[at] = arrays["edge_rest_angle"][found] * (1.0 if same else -1.0)
        length[at] = arrays["edge_rest_length"][found]
    model.edge_rest_angle.assign(angle)
    model.edge_rest_length.assign(length)
    part = slice(first_triangle, first_triangle + len(arrays["tri_areas"]))
    poses, areas = model.tri_poses.numpy(), model.tri_areas.numpy()
    poses[part], areas[part] = arrays["tri_poses"], arrays["tri_areas"]
    model.tri_poses.assign(poses)
    model.tri_areas.assign(areas)
'''

VELLUM_SCRIPT: Final = '''\
"""Python SOP after Vellum Constraints: sets restlength from vellum_stretch.csv and vellum_bend.csv.

Give the constraints (second output of the cloth set-up, made on pose.obj in metres, triangles) to the
SOP and call  apply(hou.pwd().geometry(), "/folder/of/the/csv/files").  Bend constraints are in degrees.
Whichever sign Vellum gives its angles, the change from the pose is added with that sign.
"""

import csv
import os


def apply(geometry, folder):
    def table(name, points):
        with open(os.path.join(folder, name), newline="") as file:
            rows = list(csv.reader(file))[1:]
        return {frozenset(map(int, r[:points])): list(map(float, r[points:])) for r in rows}

    stretch, bend = table("vellum_stretch.csv", 2), table("vellum_bend.csv", 4)
    bends, agreement = [], 0.0
    for prim in geometry.prims():
        points = frozenset(v.point().number() for v in prim.vertices())
        if points in stretch:
            prim.setAttribValue("restlength", stretch[points][0])
        elif points in bend:
            pose, rest = bend[points]
            bends.append((prim, pose, rest))
            agreement += pose * prim.attribValue("restlength")
    sign = 1.0 if agreement >= 0.0 else -1.0
    for prim, pose, rest in bends:
        prim.setAttribValue("restlength", prim.attribValue("restlength") + sign * (rest - pose))
'''

BLENDER_SCRIPT: Final = '''\
"""Blender: pose.obj as cloth whose springs are as long as in rest.obj.  Run in the folder of the files.

The cloth reads its rest lengths from the mesh before the modifier on every frame (dynamic mesh), so a
shape key "rest" at 0 on the first frame and at 1 from the second puts the pose first and the natural
shape under it, lengths and (with bending springs of the angular kind) angles; a rest shape key alone does
nothing.  Stiffness has other units there: set it, pins and colliders by hand.
"""

import bpy

bpy.ops.wm.obj_import(filepath="pose.obj", forward_axis="Y", up_axis="Z")
shell = bpy.context.selected_objects[0]
bpy.ops.wm.obj_import(filepath="rest.obj", forward_axis="Y", up_axis="Z")
rest = bpy.context.selected_objects[0]
shell.shape_key_add(name="Basis")
key = shell.shape_key_add(name="rest")
for at, vertex in enumerate(rest.data.vertices):
    key.data[at].co = vertex.co
bpy.data.objects.remove(rest)
for frame, value in ((1, 0.0), (2, 1.0)):
    key.value = value
    key.keyframe_insert("value", frame=frame)
cloth = shell.modifiers.new("Cloth", "CLOTH")
cloth.settings.use_dynamic_mesh = True
'''
