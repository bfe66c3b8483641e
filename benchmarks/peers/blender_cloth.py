"""Cloth of Blender, run by a Python with bpy:  python blender_cloth.py IN.npz OUT.npz

Reads only NumPy arrays (see `benchmarks.peers.scenes`), writes times (F,), positions (F,V,3) and the
wall time of the frames.  One process per run: the point cache outlives a change of the settings.
"""

import sys
import time

import bpy
import numpy as np


def mesh_object(name, vertices, faces):
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices.tolist(), [], faces.tolist())
    made = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(made)
    return made


def give_rest_shape(shell, rest):
    """Shape key at 0 on the first frame and at 1 from the second, read anew on every frame.

    `rest_shape_key` of the cloth settings alone has no effect without a user interface.
    """
    shell.shape_key_add(name="Basis")
    key = shell.shape_key_add(name="rest")
    key.data.foreach_set("co", rest.astype(np.float32).ravel())
    for frame, value in ((1, 0.0), (2, 1.0)):
        key.value = value
        key.keyframe_insert("value", frame=frame)


def add_cloth(shell, given):
    cloth = shell.modifiers.new("Cloth", "CLOTH")
    settings = cloth.settings
    settings.mass = float(given["vertex_mass"])
    settings.tension_stiffness = settings.compression_stiffness = float(given["tension"])
    settings.shear_stiffness = float(given["tension"])
    settings.bending_stiffness = float(given["bending"])
    settings.time_scale = float(given["time_scale"])
    for name in ("tension_damping", "compression_damping", "shear_damping", "bending_damping"):
        if "damping" in given:
            setattr(settings, name, float(given["damping"]))
    if "air_damping" in given:
        settings.air_damping = float(given["air_damping"])
    settings.quality = int(given["quality"])
    settings.use_dynamic_mesh = True
    if len(given["pinned"]):
        group = shell.vertex_groups.new(name="pins")
        group.add(given["pinned"].tolist(), 1.0, "REPLACE")
        settings.vertex_group_mass = "pins"
    collision = cloth.collision_settings
    collision.use_self_collision = False
    collision.use_collision = int(given["colliders"]) > 0
    collision.distance_min = 0.5 * float(given["thickness"])
    collision.friction = min(100.0 * float(given["friction"]), 80.0)
    return cloth


def add_collider(number, given):
    body = mesh_object(f"body{number}", given[f"vertices_{number}"], given[f"faces_{number}"])
    body.modifiers.new("Collision", "COLLISION")
    body.collision.thickness_outer = 0.5 * float(given["thickness"])
    body.collision.cloth_friction = min(100.0 * float(given["friction"]), 80.0)


def positions(shell, count):
    evaluated = shell.evaluated_get(bpy.context.evaluated_depsgraph_get())
    points = np.empty(3 * count, dtype=np.float32)
    evaluated.data.vertices.foreach_get("co", points)
    return points.reshape(-1, 3)


def main(source, target):
    with np.load(source, allow_pickle=False) as file:
        given = {key: file[key] for key in file.files}
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.gravity = given["gravity"].tolist()
    frames = int(given["frames"])
    scene.frame_start, scene.frame_end = 1, frames + 1
    for number in range(int(given["colliders"])):
        add_collider(number, given)
    shell = mesh_object("shell", given["start"], given["faces"])
    give_rest_shape(shell, given["rest"])
    cloth = add_cloth(shell, given)
    cloth.point_cache.frame_start, cloth.point_cache.frame_end = 1, frames + 1
    count = len(given["start"])
    kept = np.empty((frames + 1, count, 3))
    scene.frame_set(1)
    # The mesh of the object is the start; Blender hands it back as it is before the first step.
    kept[0] = positions(shell, count)
    begin = time.perf_counter()
    for frame in range(1, frames + 1):
        scene.frame_set(frame + 1)
        kept[frame] = positions(shell, count)
    seconds = time.perf_counter() - begin
    times = np.arange(frames + 1) / float(given["fps"])
    version = f"Blender {bpy.app.version_string}"
    np.savez_compressed(
        target, times=times, positions=kept, seconds=seconds, frames=frames, version=version
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
