"use strict";
// Draws surfaces and lines with WebGL 2, and turns, moves and zooms the camera.

const SURFACE_VERTEX = `#version 300 es
in vec3 place, normal;
in float contact;
uniform mat4 view, projection;
uniform float recess;
out vec3 seen, facing;
out float touching;
void main() {
  vec4 at = view * vec4(place, 1.0);
  at.xyz *= recess;
  seen = at.xyz;
  facing = mat3(view) * normal;
  touching = contact;
  gl_Position = projection * at;
}`;
// Two-sided; key, fill and head light stand still with the camera.
const SURFACE_PIXEL = `#version 300 es
precision highp float;
in vec3 seen, facing;
in float touching;
uniform vec3 front, back, contactColour;
uniform float ambient;
uniform bool twoTone;
out vec4 colour;
void main() {
  vec3 flat_ = cross(dFdx(seen), dFdy(seen));
  vec3 n = length(facing) > 0.0 ? normalize(facing) : normalize(flat_);
  bool outside = dot(n, flat_) * sign(-dot(flat_, seen)) > 0.0;
  if (!outside) n = -n;
  float light = 0.55 * max(dot(n, normalize(vec3(-0.5, 0.8, 0.8))), 0.0)
    + 0.18 * max(dot(n, normalize(vec3(0.9, 0.1, 0.6))), 0.0)
    + 0.42 * max(n.z, 0.0);
  vec3 paint = outside || !twoTone ? front : back;
  paint = mix(paint, contactColour, 0.72 * smoothstep(0.15, 0.85, touching));
  float shine = 0.05 * pow(max(n.z, 0.0), 24.0);
  colour = vec4(paint * (ambient + (1.05 - ambient) * light) + shine, 1.0);
}`;
// A line is a quad that keeps its width in pixels, drawn a little nearer to the eye.
const LINE_VERTEX = `#version 300 es
in vec2 corner;
in vec3 start, end;
uniform mat4 view, projection;
uniform vec2 pixels;
uniform float width, lift;
void main() {
  vec4 a = view * vec4(start, 1.0), b = view * vec4(end, 1.0);
  a.xyz *= lift;
  b.xyz *= lift;
  vec4 p = projection * a, q = projection * b;
  vec2 along = (q.xy / q.w - p.xy / p.w) * pixels;
  along = length(along) > 1e-6 ? normalize(along) : vec2(1.0, 0.0);
  vec4 at = corner.x < 0.5 ? p : q;
  at.xy += vec2(-along.y, along.x) * corner.y * width / pixels * at.w;
  gl_Position = at;
}`;
const LINE_PIXEL = `#version 300 es
precision highp float;
uniform vec4 ink;
out vec4 colour;
void main() { colour = vec4(ink.rgb * ink.a, ink.a); }`;

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const mix = (...terms) => [0, 1, 2].map((axis) => terms.reduce((sum, [share, v]) => sum + share * v[axis], 0));
const hex = (text) => [1, 3, 5].map((n) => parseInt(text.slice(n, n + 2), 16) / 255);

class Camera {
  constructor(data) {
    this.data = data;
    this.axes = data.axes;
    this.reset();
  }
  reset() {
    const start = this.data.camera;
    const [right, up, front] = this.axes;
    const away = mix([1, start.position], [-1, start.focus]);
    this.home = Math.hypot(...away);
    this.azimuth = Math.atan2(dot(away, right), dot(away, front));
    this.elevation = Math.asin(dot(away, up) / this.home);
    this.focus = start.focus.slice();
    this.zoom = 1;
  }
  // The farther side of the picture must fit, as in the camera the data was framed with.
  distance(aspect) {
    return this.zoom * this.home * Math.max(1, this.data.camera.aspect / aspect);
  }
  basis() {
    const [right, up, front] = this.axes;
    const level = mix([Math.cos(this.azimuth), front], [Math.sin(this.azimuth), right]);
    const back = mix([Math.cos(this.elevation), level], [Math.sin(this.elevation), up]);
    const across = mix([Math.cos(this.azimuth), right], [-Math.sin(this.azimuth), front]);
    return [across, cross(back, across), back];
  }
  orbit(dx, dy) {
    this.azimuth -= 0.008 * dx;
    this.elevation = Math.min(1.55, Math.max(-1.55, this.elevation + 0.008 * dy));
  }
  pan(dx, dy, width, height) {
    const size = 2 * Math.tan(0.5 * this.data.camera.angle) * this.distance(width / height) / height;
    const [across, above] = this.basis();
    this.focus = mix([1, this.focus], [-dx * size, across], [dy * size, above]);
  }
  scale(factor) {
    this.zoom = Math.min(8, Math.max(0.04, this.zoom * factor));
  }
  matrices(aspect) {
    const distance = this.distance(aspect);
    const [x, y, z] = this.basis();
    const eye = mix([1, this.focus], [distance, z]);
    const view = [x[0], y[0], z[0], 0, x[1], y[1], z[1], 0, x[2], y[2], z[2], 0, -dot(x, eye), -dot(y, eye), -dot(z, eye), 1];
    const [cx, cy, cz, radius] = this.data.ball;
    const depth = dot(z, mix([1, eye], [-1, [cx, cy, cz]]));
    const far = Math.max(1.1 * (depth + radius), 0.02 * distance);
    const near = Math.max(0.9 * (depth - radius), 2e-3 * far);
    const slope = 1 / Math.tan(0.5 * this.data.camera.angle);
    const projection = [slope / aspect, 0, 0, 0, 0, slope, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0];
    return { view: view, projection: projection };
  }
}

class View {
  constructor(canvas, data) {
    this.canvas = canvas;
    this.gl = canvas.getContext("webgl2", { antialias: true, alpha: false });
    if (!this.gl) throw new Error("This browser has no WebGL 2, which the three-dimensional view needs.");
    this.data = data;
    this.camera = new Camera(data);
    this.shows = { edges: true, lines: true, contact: true, body: true };
    this.surfaceProgram = this.program(SURFACE_VERTEX, SURFACE_PIXEL);
    this.lineProgram = this.program(LINE_VERTEX, LINE_PIXEL);
    this.quad = this.buffer(new Float32Array([0, -1, 1, -1, 0, 1, 1, 1]));
    const frames = data.times.length;
    this.items = data.tracks.map((track) => this.item(new Surface(track, frames)));
    this.at(0, 0);
  }

  item(surface) {
    const gl = this.gl;
    const corners = this.buffer(surface.corners);
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, corners);
    for (const [name, size, offset] of [["place", 3, 0], ["normal", 3, 12], ["contact", 1, 24]]) {
      const slot = gl.getAttribLocation(this.surfaceProgram, name);
      gl.enableVertexAttribArray(slot);
      gl.vertexAttribPointer(slot, size, gl.FLOAT, false, 28, offset);
    }
    gl.bindVertexArray(null);
    return {
      surface: surface, corners: corners, array: array, done: false,
      lines: this.strokes(surface.segments), edges: this.strokes(surface.edgeSegments), rim: this.strokes(surface.rimSegments),
    };
  }

  strokes(values) {
    if (!values || !values.length) return null;
    const gl = this.gl;
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    const corner = gl.getAttribLocation(this.lineProgram, "corner");
    gl.bindBuffer(gl.ARRAY_BUFFER, this.quad);
    gl.enableVertexAttribArray(corner);
    gl.vertexAttribPointer(corner, 2, gl.FLOAT, false, 0, 0);
    const ends = this.buffer(values);
    for (const [name, offset] of [["start", 0], ["end", 12]]) {
      const slot = gl.getAttribLocation(this.lineProgram, name);
      gl.enableVertexAttribArray(slot);
      gl.vertexAttribPointer(slot, 3, gl.FLOAT, false, 24, offset);
      gl.vertexAttribDivisor(slot, 1);
    }
    gl.bindVertexArray(null);
    return { values: values, buffer: ends, array: array };
  }

  buffer(values) {
    const made = this.gl.createBuffer();
    this.gl.bindBuffer(this.gl.ARRAY_BUFFER, made);
    this.gl.bufferData(this.gl.ARRAY_BUFFER, values, this.gl.DYNAMIC_DRAW);
    return made;
  }

  program(vertex, pixel) {
    const gl = this.gl;
    const made = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, pixel]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(made, shader);
    }
    gl.linkProgram(made);
    if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
    return made;
  }

  // Moves everything to a frame, or between it and the next.
  at(frame, share) {
    const gl = this.gl;
    if (this.time === frame + share) return;
    this.time = frame + share;
    for (const item of this.items) {
      if (item.done) continue;
      item.surface.at(frame, share);
      const changed = [item.lines, item.edges, item.rim].filter(Boolean).map((made) => [made.buffer, made.values]);
      for (const [buffer, values] of [[item.corners, item.surface.corners], ...changed]) {
        gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
        gl.bufferSubData(gl.ARRAY_BUFFER, 0, values);
      }
      item.done = item.surface.still && !item.surface.bits && !item.surface.lines;
    }
  }

  draw(palette) {
    const gl = this.gl;
    const scale = window.devicePixelRatio || 1;
    const width = Math.max(1, Math.round(this.canvas.clientWidth * scale));
    const height = Math.max(1, Math.round(this.canvas.clientHeight * scale));
    if (this.canvas.width !== width || this.canvas.height !== height) {
      this.canvas.width = width;
      this.canvas.height = height;
    }
    gl.viewport(0, 0, width, height);
    gl.clearColor(...hex(palette.paper), 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.disable(gl.BLEND);
    const matrices = this.camera.matrices(width / height);
    this.surfaces(palette, matrices);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthMask(false);
    this.lines(palette, matrices, [width, height], scale);
    gl.depthMask(true);
  }

  surfaces(palette, matrices) {
    const gl = this.gl;
    const put = this.uniforms(this.surfaceProgram, matrices);
    for (const { surface, array } of this.items) {
      if (surface.track.body && !this.shows.body) continue;
      gl.uniform1f(put("recess"), surface.track.body ? 1.0025 : 1);
      gl.uniform3fv(put("front"), hex(surface.track.body ? palette.body : palette.shell));
      gl.uniform3fv(put("back"), hex(surface.track.body ? palette.body : palette.inside));
      gl.uniform3fv(put("contactColour"), hex(this.shows.contact ? palette.contact : palette.shell));
      gl.uniform1f(put("ambient"), surface.track.body ? 0.3 : surface.lines ? 0.58 : 0.44);
      gl.uniform1i(put("twoTone"), surface.track.oneSided ? 0 : 1);
      gl.bindVertexArray(array);
      gl.drawArrays(gl.TRIANGLES, 0, surface.faces.length);
    }
  }

  lines(palette, matrices, pixels, scale) {
    const gl = this.gl;
    const put = this.uniforms(this.lineProgram, matrices);
    gl.uniform2fv(put("pixels"), pixels);
    gl.uniform1f(put("lift"), 0.9988);
    for (const item of this.items) {
      const kinds = [["edges", palette.edge, 1], ["rim", palette.rim, 1.6], ["lines", palette.ruling, 1.6]];
      for (const [kind, ink, wide] of kinds) {
        if (!item[kind] || (kind !== "rim" && !this.shows[kind])) continue;
        gl.uniform4fv(put("ink"), [...hex(ink[0]), ink[1]]);
        gl.uniform1f(put("width"), wide * scale);
        gl.bindVertexArray(item[kind].array);
        gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, item[kind].values.length / 6);
      }
    }
  }

  uniforms(program, matrices) {
    const gl = this.gl;
    gl.useProgram(program);
    const put = (name) => gl.getUniformLocation(program, name);
    gl.uniformMatrix4fv(put("view"), false, matrices.view);
    gl.uniformMatrix4fv(put("projection"), false, matrices.projection);
    return put;
  }
}
