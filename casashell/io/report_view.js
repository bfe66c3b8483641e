"use strict";
// Builds the 3-D view from the JSON in #view-data; needs Plotly. Writes only into #view.
(function () {
  const data = JSON.parse(document.getElementById("view-data").textContent);
  const host = document.getElementById("view");

  function unpack(packed) {
    const text = atob(packed.d);
    const bytes = new Uint8Array(text.length);
    for (let n = 0; n < text.length; n++) bytes[n] = text.charCodeAt(n);
    return packed.t === "i4" ? new Int32Array(bytes.buffer) : new Float32Array(bytes.buffer);
  }
  function column(flat, width, which) {
    const made = new flat.constructor(flat.length / width);
    for (let n = 0; n < made.length; n++) made[n] = flat[n * width + which];
    return made;
  }
  // Plotly's turntable only knows z as up: the axes are shifted round until the scene's up is z,
  // and labelled with their own names.  A slanted up is left alone and orbits.
  const upright = data.up.findIndex((value) => value > 0.999);
  const order = upright < 0 ? [0, 1, 2] : [(upright + 1) % 3, (upright + 2) % 3, upright];
  const shift = (triple) => order.map((axis) => triple[axis]);
  function corners(packed) {
    const flat = unpack(packed);
    const [x, y, z] = order.map((axis) => column(flat, 3, axis));
    return { x: x, y: y, z: z };
  }
  function triangles(packed) {
    const flat = unpack(packed);
    return { i: column(flat, 3, 0), j: column(flat, 3, 1), k: column(flat, 3, 2) };
  }
  function show(value, digits) {
    return Number(value).toPrecision(digits || 3).replace("-", "\u2212");
  }
  function newtons(value) {
    const size = Math.abs(value);
    if (size >= 1 || size === 0) return show(value) + " N";
    if (size >= 1e-3) return show(1e3 * value) + " mN";
    if (size >= 1e-6) return show(1e6 * value) + " µN";
    return show(1e9 * value) + " nN";
  }

  const toEye = shift(data.eye);
  const up = shift(data.up);
  const light = {
    lightposition: { x: 0, y: 0, z: 1e5 },
    lighting: { ambient: 0.52, diffuse: 0.5, specular: 0.04, roughness: 0.9, fresnel: 0 },
    flatshading: false,
  };
  const traces = [];
  const roles = [];
  function add(role, trace) {
    traces.push(Object.assign({ showlegend: false }, trace));
    roles.push(role);
  }
  function bar(title) {
    return { title: { text: title + "<br> ", side: "top" }, thickness: 14, len: 0.8, x: 0.995, xanchor: "right",
      outlinewidth: 0 };
  }

  const ids = unpack(data.shell.ids);
  const stretch = unpack(data.shell.stretch);
  const bend = unpack(data.shell.bend);
  const target = corners(data.shell.target);
  const natural = corners(data.shell.natural);
  const faces = triangles(data.shell.faces);
  const hover = Array.from(ids, (id, n) =>
    "vertex " + id + "<br>stretch " + show(stretch[n]) + " %<br>bending " + show(bend[n]) + "°");
  const told = { text: hover, hovertemplate: "%{text}<extra></extra>" };

  for (const obstacle of data.obstacles) {
    add("obstacle", Object.assign({ type: "mesh3d", color: data.colours.obstacle, hoverinfo: "skip" },
      corners(obstacle.points), triangles(obstacle.faces), light));
  }
  function shell(role, points, extra) {
    add(role, Object.assign({ type: "mesh3d" }, points, faces, light, told, extra));
  }
  function mapped(role, values, map, title) {
    shell(role, natural, {
      intensity: values, cmin: map.low, cmax: map.high, colorscale: map.scale,
      colorbar: bar(title), showscale: true,
    });
  }
  shell("target", target, { color: data.colours.shell });
  shell("pale", target, { color: "#dfe6ee" });
  shell("natural", natural, { color: data.colours.natural });
  mapped("stretch", stretch, data.maps.stretch, "stretch [%]");
  mapped("bend", bend, data.maps.bend, "bending [°]");

  // Lines on a surface vanish in it: edges are drawn twice, just off either side.
  function lifted(points, height) {
    const normal = { x: new Float32Array(ids.length), y: new Float32Array(ids.length), z: new Float32Array(ids.length) };
    for (let n = 0; n < faces.i.length; n++) {
      const [a, b, c] = [faces.i[n], faces.j[n], faces.k[n]];
      const u = { x: points.x[b] - points.x[a], y: points.y[b] - points.y[a], z: points.z[b] - points.z[a] };
      const v = { x: points.x[c] - points.x[a], y: points.y[c] - points.y[a], z: points.z[c] - points.z[a] };
      for (const at of [a, b, c]) {
        normal.x[at] += u.y * v.z - u.z * v.y;
        normal.y[at] += u.z * v.x - u.x * v.z;
        normal.z[at] += u.x * v.y - u.y * v.x;
      }
    }
    const made = { x: points.x.slice(), y: points.y.slice(), z: points.z.slice() };
    for (let n = 0; n < ids.length; n++) {
      const size = Math.hypot(normal.x[n], normal.y[n], normal.z[n]) || 1;
      for (const axis of ["x", "y", "z"]) made[axis][n] += height * normal[axis][n] / size;
    }
    return made;
  }
  function wires(role, points, pairs) {
    // Segments apart by a gap: NaN ends a line.
    const made = { x: [], y: [], z: [] };
    for (const axis of ["x", "y", "z"]) {
      const line = new Float32Array(3 * pairs.length / 2);
      for (let n = 0; n < pairs.length / 2; n++) {
        line[3 * n] = points[axis][pairs[2 * n]];
        line[3 * n + 1] = points[axis][pairs[2 * n + 1]];
        line[3 * n + 2] = NaN;
      }
      made[axis] = line;
    }
    add(role, Object.assign({ type: "scatter3d", mode: "lines", hoverinfo: "skip", connectgaps: false,
      line: { color: "rgba(30,36,44,0.35)", width: 1.5 } }, made));
  }
  if (data.edges) {
    const pairs = unpack(data.edges);
    const lift = 0.0012 * Math.hypot.apply(null, data.box.map((range) => range[1] - range[0]));
    for (const side of [lift, -lift]) {
      wires("edges-target", lifted(target, side), pairs);
      wires("edges-natural", lifted(natural, side), pairs);
    }
  }
  for (const rim of data.rims) {
    add("outline", Object.assign({ type: "scatter3d", mode: "lines", hoverinfo: "skip",
      line: { color: "#2f5f93", width: 4 } }, corners(rim)));
  }

  const arrows = data.arrows;
  const use = unpack(arrows.use);
  if (use.length) {
    const points = corners(arrows.points);
    const flat = unpack(arrows.faces);
    const where = unpack(arrows.vertices);
    const normal = unpack(arrows.normal);
    const tangential = unpack(arrows.tangential);
    const friction = unpack(arrows.friction);
    const gap = unpack(arrows.gap);
    const words = Array.from(use, (share, n) =>
      "contact at vertex " + where[n] + "<br>normal " + newtons(normal[n]) +
      "<br>tangential " + newtons(tangential[n]) + "<br>friction µ " + show(friction[n]) +
      ", in use " + (share > 1e5 ? "beyond the cone" : show(share) + " %") +
      "<br>gap " + show(1e3 * gap[n]) + " mm");
    const each = arrows.perArrow;
    const text = new Array(use.length * each);
    const level = new Float32Array(use.length * each);
    for (let n = 0; n < text.length; n++) {
      const contact = Math.floor(n / each);
      text[n] = words[contact];
      level[n] = Math.min(use[contact], 100);
    }
    const held = [];
    const slips = [];
    for (let n = 0; n < flat.length; n += 3) {
      const contact = Math.floor(n / 3 / arrows.facesPerArrow);
      (use[contact] > arrows.limit ? slips : held).push(n);
    }
    const bright = { lighting: { ambient: 0.75, diffuse: 0.35, specular: 0, fresnel: 0 }, flatshading: true };
    const chosen = (list) => ({
      i: list.map((n) => flat[n]), j: list.map((n) => flat[n + 1]), k: list.map((n) => flat[n + 2]),
    });
    const saying = { text: text, hovertemplate: "%{text}<extra></extra>" };
    add("forces", Object.assign({ type: "mesh3d", intensity: level, cmin: 0, cmax: 100,
      colorscale: data.maps.use.scale, colorbar: bar("friction in use [%]"), showscale: true },
    points, chosen(held), bright, saying));
    if (slips.length) {
      add("forces", Object.assign({ type: "mesh3d", color: data.colours.beyond }, points,
        chosen(slips), bright, saying));
    }
  }
  if (data.pinned.d) {
    add("pinned", Object.assign({ type: "scatter3d", mode: "markers", hovertemplate: "pinned<extra></extra>",
      marker: { color: data.colours.pinned, size: 5 } }, corners(data.pinned)));
  }

  const views = {
    target: ["target", "obstacle", "edges-target", "pinned"],
    forces: ["pale", "forces", "obstacle", "edges-target", "pinned"],
    natural: ["natural", "edges-natural", "outline", "obstacle"],
    stretch: ["stretch", "edges-natural", "outline", "obstacle"],
    bend: ["bend", "edges-natural", "outline", "obstacle"],
  };
  const state = { view: "target", obstacle: true, edges: true, outline: true };
  const asked = window.location.hash.slice(1);
  if (views[asked]) state.view = asked;
  function visible() {
    const natural = state.view !== "target" && state.view !== "forces";
    const option = {
      obstacle: natural ? state.behind === true : state.obstacle,
      "edges-target": state.edges, "edges-natural": state.edges, outline: state.outline,
    };
    return roles.map((role) => views[state.view].includes(role) && option[role] !== false);
  }

  const axes = ["x", "y", "z"];
  const ranges = shift(data.box);
  const names = shift(axes);
  const spans = ranges.map((range) => range[1] - range[0]);
  const longest = Math.max.apply(null, spans);
  // In a narrow window the colour bar would lie over the shell, and the shell reach over the sides.
  const share = host.clientWidth < 760 ? 0.8 : 1;
  const away = 1.75 * Math.max(1, 0.9 * host.clientHeight / (share * host.clientWidth));
  const scene = {
    domain: { x: [0, share] },
    aspectmode: "manual", aspectratio: {},
    camera: {
      up: { x: up[0], y: up[1], z: up[2] },
      eye: { x: away * toEye[0], y: away * toEye[1], z: away * toEye[2] },
    },
    dragmode: upright >= 0 ? "turntable" : "orbit",
  };
  axes.forEach((axis, n) => {
    scene.aspectratio[axis] = 1.15 * spans[n] / longest;
    scene[axis + "axis"] = {
      range: ranges[n], title: { text: names[n] + " [m]", font: { size: 11 } }, nticks: 5,
      tickfont: { size: 10, color: "#6b7280" }, gridcolor: "#dde1e6", zeroline: false,
      showspikes: false, backgroundcolor: "rgba(0,0,0,0)",
    };
  });
  traces.forEach((trace, n) => { trace.visible = visible()[n]; });
  const layout = {
    scene: scene, margin: { l: 0, r: 0, t: 0, b: 0 }, autosize: true, uirevision: "keep",
    paper_bgcolor: "#eff1f4", font: { family: "system-ui, sans-serif", size: 12, color: "#23272e" },
    hoverlabel: { align: "left" },
  };
  const config = { displaylogo: false, responsive: true, scrollZoom: true,
    modeBarButtonsToRemove: ["tableRotation", "resetCameraLastSave3d", "hoverClosest3d"] };

  const legend = document.getElementById("view-legend");
  const legends = {
    target: "The designed shape. Grey: what it lies on.",
    forces: arrows.legend.charAt(0).toUpperCase() + arrows.legend.slice(1) + ". Colour: share of the available friction in use; red: beyond it.",
    natural: "The shape to cut and sew, laid on the target as well as it goes. Dark blue: rims of the target.",
    stretch: "Edge lengths, natural against target. Blue: shorter, red: longer.",
    bend: "Dihedral angles, natural against target. White: unchanged.",
  };
  function refresh() {
    const natural = state.view !== "target" && state.view !== "forces";
    document.querySelectorAll("[data-view]").forEach((button) => {
      button.setAttribute("aria-pressed", String(button.dataset.view === state.view));
    });
    const box = document.querySelector("[data-option=obstacle]");
    box.checked = natural ? state.behind === true : state.obstacle;
    document.querySelector("[data-option=outline]").parentElement.hidden = !natural || !data.rims.length;
    legend.textContent = legends[state.view];
    Plotly.restyle(host, { visible: visible() });
  }
  document.querySelectorAll("[data-view]").forEach((button) => {
    button.addEventListener("click", () => { state.view = button.dataset.view; refresh(); });
  });
  document.querySelectorAll("[data-option]").forEach((box) => {
    box.addEventListener("change", () => {
      const natural = state.view !== "target" && state.view !== "forces";
      const name = box.dataset.option === "obstacle" && natural ? "behind" : box.dataset.option;
      state[name] = box.checked;
      refresh();
    });
  });
  document.querySelector("[data-option=edges]").parentElement.hidden = !data.edges;
  document.querySelector("[data-option=obstacle]").parentElement.hidden = !data.obstacles.length;
  host.textContent = "";
  Plotly.newPlot(host, traces, layout, config).then(refresh);
})();
