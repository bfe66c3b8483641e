"use strict";
// Positions, normals and line segments of the tracks at any time.  Knows nothing of the screen.

function unpack(packed) {
  const text = atob(packed.d);
  const bytes = new Uint8Array(text.length);
  for (let n = 0; n < text.length; n++) bytes[n] = text.charCodeAt(n);
  const kinds = { i2: Int16Array, u1: Uint8Array, i4: Int32Array, f4: Float32Array };
  return new kinds[packed.t](bytes.buffer);
}

// Frames of points, kept as the integers they come in.
class Points {
  constructor(packed, frames) {
    this.values = unpack(packed);
    this.center = packed.center;
    this.step = packed.step;
    this.count = this.values.length / frames;
  }
  // Coordinates between two frames into `made`; a share of 0 is exactly the first.
  fill(made, frame, share) {
    const last = this.values.length / this.count - 1;
    const here = Math.min(frame, last) * this.count;
    const next = Math.min(frame + 1, last) * this.count;
    for (let n = 0; n < this.count; n++) {
      const whole = (1 - share) * this.values[here + n] + share * this.values[next + n];
      made[n] = this.center[n % 3] + this.step * whole;
    }
  }
}

class Surface {
  constructor(track, frames) {
    this.track = track;
    this.faces = unpack(track.faces);
    this.source = new Points(track.points, track.still ? 1 : frames);
    this.motion = track.motion && unpack(track.motion);
    this.bits = track.contact && unpack(track.contact);
    this.lines = track.lines && new Points(track.lines, frames);
    this.still = track.still && !this.motion;
    this.count = this.source.count / 3;
    this.points = new Float32Array(this.source.count);
    this.normals = new Float32Array(this.faces.length);
    this.areas = new Float32Array(this.faces.length);
    // Position, normal and contact of every corner: normals differ across creases.
    this.corners = new Float32Array(7 * this.faces.length);
    this.segments = this.lines && new Float32Array(this.lines.count);
    this.around = this.neighbours();
    const [edges, rim] = this.sides();
    this.edges = track.edges ? edges : [];
    this.rim = track.body ? [] : rim;
    this.edgeSegments = new Float32Array(3 * this.edges.length);
    this.rimSegments = new Float32Array(3 * this.rim.length);
  }

  // For each vertex the faces that meet there, as one list with starts.
  neighbours() {
    const start = new Int32Array(this.count + 1);
    for (const vertex of this.faces) start[vertex + 1]++;
    for (let n = 0; n < this.count; n++) start[n + 1] += start[n];
    const list = new Int32Array(this.faces.length);
    const fill = start.slice();
    for (let n = 0; n < this.faces.length; n++) list[fill[this.faces[n]]++] = Math.floor(n / 3);
    return { start: start, list: list };
  }

  // Vertex pairs of all edges, and of those with one face only.
  sides() {
    const uses = new Map();
    for (let n = 0; n < this.faces.length; n++) {
      const a = this.faces[n];
      const b = this.faces[n % 3 === 2 ? n - 2 : n + 1];
      const key = Math.min(a, b) * this.count + Math.max(a, b);
      uses.set(key, (uses.get(key) || 0) + 1);
    }
    const every = [];
    const rim = [];
    for (const [key, count] of uses) {
      const pair = [Math.floor(key / this.count), key % this.count];
      every.push(...pair);
      if (count === 1) rim.push(...pair);
    }
    return [every, rim];
  }

  at(frame, share) {
    this.place(frame, share);
    this.faceNormals();
    const faces = this.faces;
    const corners = this.corners;
    // A body keeps creases above 40 degrees, cloth is smooth but for sharp folds.
    const limit = this.track.body ? 0.77 : 0.1;
    const nearest = share < 0.5 ? frame : frame + 1;
    for (let n = 0; n < faces.length; n++) {
      const vertex = faces[n];
      const to = 7 * n;
      for (let axis = 0; axis < 3; axis++) corners[to + axis] = this.points[3 * vertex + axis];
      this.cornerNormal(Math.floor(n / 3), vertex, limit, to + 3);
      corners[to + 6] = this.touches(nearest, vertex) ? 1 : 0;
    }
    if (this.lines) this.lines.fill(this.segments, frame, share);
    this.gather(this.edges, this.edgeSegments);
    this.gather(this.rim, this.rimSegments);
  }

  place(frame, share) {
    this.source.fill(this.points, frame, share);
    if (!this.motion) return;
    const last = this.motion.length / 12 - 1;
    const here = 12 * Math.min(frame, last);
    const next = 12 * Math.min(frame + 1, last);
    const m = new Float64Array(12);
    for (let n = 0; n < 12; n++) m[n] = (1 - share) * this.motion[here + n] + share * this.motion[next + n];
    const p = this.points;
    const [cx, cy, cz] = this.source.center;
    for (let n = 0; n < p.length; n += 3) {
      const [x, y, z] = [p[n] - cx, p[n + 1] - cy, p[n + 2] - cz];
      for (let axis = 0; axis < 3; axis++) p[n + axis] = x * m[axis] + y * m[3 + axis] + z * m[6 + axis] + m[9 + axis];
    }
  }

  touches(frame, vertex) {
    if (!this.bits) return false;
    const bit = frame * this.count + vertex;
    return (this.bits[bit >> 3] >> (7 - (bit & 7))) & 1;
  }

  faceNormals() {
    const p = this.points;
    for (let n = 0; n < this.faces.length; n += 3) {
      const [a, b, c] = [3 * this.faces[n], 3 * this.faces[n + 1], 3 * this.faces[n + 2]];
      const [ux, uy, uz] = [p[b] - p[a], p[b + 1] - p[a + 1], p[b + 2] - p[a + 2]];
      const [vx, vy, vz] = [p[c] - p[a], p[c + 1] - p[a + 1], p[c + 2] - p[a + 2]];
      const [x, y, z] = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
      const size = Math.hypot(x, y, z) || 1;
      this.areas[n] = x;
      this.areas[n + 1] = y;
      this.areas[n + 2] = z;
      this.normals[n] = x / size;
      this.normals[n + 1] = y / size;
      this.normals[n + 2] = z / size;
    }
  }

  // Mean over the faces at the vertex that lean the same way as this one; on a one-sided band a
  // face may be counted from its other side.
  cornerNormal(face, vertex, limit, to) {
    const own = 3 * face;
    const normals = this.normals;
    let [x, y, z] = [0, 0, 0];
    for (let n = this.around.start[vertex]; n < this.around.start[vertex + 1]; n++) {
      const other = 3 * this.around.list[n];
      const lean = normals[own] * normals[other] + normals[own + 1] * normals[other + 1] + normals[own + 2] * normals[other + 2];
      const sign = lean > limit ? 1 : this.track.oneSided && lean < -limit ? -1 : 0;
      x += sign * this.areas[other];
      y += sign * this.areas[other + 1];
      z += sign * this.areas[other + 2];
    }
    const size = Math.hypot(x, y, z) || 1;
    this.corners[to] = x / size;
    this.corners[to + 1] = y / size;
    this.corners[to + 2] = z / size;
  }

  gather(pairs, made) {
    for (let n = 0; n < pairs.length; n++) {
      for (let axis = 0; axis < 3; axis++) made[3 * n + axis] = this.points[3 * pairs[n] + axis];
    }
  }
}
