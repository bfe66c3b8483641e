"""Cloth of Newton (VBD), run by a Python with newton:  python newton_vbd.py IN.npz OUT.npz

Reads only NumPy arrays (see `benchmarks.peers.scenes`), writes times (F,), positions (F,V,3) and the
wall time of the frames; the first frame, which compiles kernels, is not in it.
"""

import sys
import time

import newton
import numpy as np
import warp as wp

PLANE, CONE, SPHERE = 1, 2, 3


def turned_z(axis):
    """Quaternion that takes +z to ``axis``."""
    return wp.quat_between_vectors(wp.vec3(0.0, 0.0, 1.0), wp.vec3(*(float(a) for a in axis)))


def add_shape(builder, number, given):
    """The obstacle, its surface already sunk by the thickness of the shell."""
    kind, values = int(given[f"kind_{number}"]), given[f"values_{number}"]
    if kind == PLANE:
        normal, offset = values[:3], float(values[3])
        builder.add_shape_plane(plane=(*normal.tolist(), -offset))
    elif kind == CONE:
        apex, axis, angle, length = values[:3], values[3:6], float(values[6]), float(values[7])
        middle = wp.vec3(*(apex + 0.5 * length * axis).tolist())
        place = wp.transform(middle, turned_z(-axis))
        radius = length * float(np.tan(angle))
        builder.add_shape_cone(-1, xform=place, radius=radius, half_height=0.5 * length)
    elif kind == SPHERE:
        place = wp.transform(wp.vec3(*values[:3].tolist()), wp.quat_identity())
        builder.add_shape_sphere(-1, xform=place, radius=float(values[3]))
    else:
        mesh = newton.Mesh(given[f"vertices_{number}"], given[f"faces_{number}"].ravel())
        builder.add_shape_mesh(-1, mesh=mesh)


def model_of(given):
    """The model with natural shape ``rest``: own triangles, or springs on all edges instead."""
    builder = newton.ModelBuilder(gravity=wp.vec3(*given["gravity"].tolist()))
    builder.default_shape_cfg.mu = float(given["friction"])
    builder.default_shape_cfg.ke = float(given["contact_ke"])
    for number in range(int(given["colliders"])):
        add_shape(builder, number, given)
    springs = bool(given["springs"])
    membrane = 0.0 if springs else 0.375 * float(given["membrane"])
    builder.add_cloth_mesh(
        pos=wp.vec3(0.0, 0.0, 0.0),
        rot=wp.quat_identity(),
        scale=1.0,
        vel=wp.vec3(0.0, 0.0, 0.0),
        vertices=[wp.vec3(*row) for row in given["rest"].tolist()],
        indices=given["faces"].ravel().tolist(),
        density=float(given["density"]),
        tri_ke=membrane,
        tri_ka=membrane,
        tri_kd=0.0,
        edge_ke=1.0,
        edge_kd=0.0,
        particle_radius=float(given["thickness"]),
    )
    if springs:
        for (a, b), ke in zip(given["edges"].tolist(), given["spring_ke"].tolist()):
            builder.add_spring(a, b, ke, 0.0, 0)
    for pin in given["pinned"].tolist():
        builder.particle_mass[pin] = 0.0
    builder.color(include_bending=True)
    model = builder.finalize(device="cpu")
    set_bending(model, given)
    model.particle_radius.assign(given["radii"].astype(np.float32))
    model.soft_contact_ke = float(given["contact_ke"])
    model.soft_contact_mu = float(given["friction"])
    return model


def set_bending(model, given):
    """Stiffness hinge by hinge; Newton multiplies it by the length of the edge."""
    stiffness = dict(zip(map(tuple, np.sort(given["hinges"][:, :2], 1).tolist()), given["edge_ke"]))
    rows = np.sort(model.edge_indices.numpy().reshape(-1, 4)[:, 2:], 1).tolist()
    values = model.edge_bending_properties.numpy()
    values[:, 0] = [stiffness.get(tuple(row), 0.0) for row in rows]
    model.edge_bending_properties.assign(values)


def main(source, target):
    with np.load(source, allow_pickle=False) as file:
        given = {key: file[key] for key in file.files}
    wp.config.quiet = True
    model = model_of(given)
    pipeline = newton.CollisionPipeline(model, broad_phase="nxn", soft_contact_gap=0.02)
    solver = newton.solvers.SolverVBD(
        model,
        iterations=int(given["iterations"]),
        friction_epsilon=float(given["friction_epsilon"]),
        collision_pipeline=pipeline,
    )
    now, after, control = model.state(), model.state(), model.control()
    now.particle_q.assign(given["start"].astype(np.float32))
    frames, steps = int(given["frames"]), int(given["substeps"])
    step = 1.0 / (float(given["fps"]) * steps)
    kept = np.empty((frames + 1, len(given["start"]), 3))
    kept[0] = now.particle_q.numpy()
    begin = time.perf_counter()
    for frame in range(1, frames + 1):
        for _ in range(steps):
            now.clear_forces()
            solver.step(now, after, control, None, step)
            now, after = after, now
        kept[frame] = now.particle_q.numpy()
        if frame == 1:
            begin = time.perf_counter()
    seconds = time.perf_counter() - begin
    times = np.arange(frames + 1) / float(given["fps"])
    version = f"Newton {newton.__version__}"
    np.savez_compressed(
        target, times=times, positions=kept, seconds=seconds, frames=frames - 1, version=version
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
