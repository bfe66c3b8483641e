"use strict";
// The page around the view: time, keys, pointer, curves.
(function () {
  const data = JSON.parse(document.getElementById("data").textContent);
  const part = (id) => document.getElementById(id);
  const times = data.times.map((time) => time - data.times[0]);
  const frames = times.length;
  const length = times[frames - 1];
  const speeds = [0.05, 0.1, 0.25, 0.5, 1, 2, 4, 8];
  const state = { time: 0, playing: false, speed: 1, last: 0, dirty: true };
  const palettes = {
    light: { paper: "#f5f6f8", body: data.colours.body, edge: ["#20262d", 0.2], rim: ["#2f5f93", 0.9], ruling: ["#1f3f66", 0.75] },
    dark: { paper: "#15181d", body: "#5b616b", edge: ["#0b0d10", 0.32], rim: ["#bcd6f2", 0.8], ruling: ["#0e1c2e", 0.8] },
  };
  const shell = { shell: data.colours.shell, inside: data.colours.inside, contact: data.colours.contact };
  let theme = "light";
  let view = null;

  function fail(problem) {
    part("failure").hidden = false;
    part("failure").textContent = problem.message;
    document.documentElement.dataset.failure = problem.message;
  }
  try {
    view = new View(part("view"), data);
  } catch (problem) {
    fail(problem);
  }

  // Time: the frame at or before it, and how far it is towards the next.
  function place(time) {
    let low = 0;
    let high = frames - 1;
    while (high > low) {
      const middle = (low + high + 1) >> 1;
      if (times[middle] <= time) low = middle;
      else high = middle - 1;
    }
    const next = Math.min(low + 1, frames - 1);
    return [low, next > low ? (time - times[low]) / (times[next] - times[low]) : 0];
  }
  function nearest() {
    const [frame, share] = place(state.time);
    return share < 0.5 ? frame : Math.min(frame + 1, frames - 1);
  }
  function goTo(frame) {
    state.time = times[Math.min(frames - 1, Math.max(0, frame))];
    state.dirty = true;
  }
  function play(wanted) {
    if (frames < 2) return;
    state.playing = wanted;
    if (wanted && state.time >= length) state.time = 0;
    if (!wanted) goTo(nearest());
    part("play").setAttribute("aria-label", wanted ? "Pause" : "Play");
    part("play").querySelector("path").setAttribute("d", wanted ? "M4 3h4v14H4zM12 3h4v14h-4z" : "M5 2.5v15l12-7.5z");
  }
  function setSpeed(value) {
    state.speed = value;
    part("speed").value = String(value);
  }

  // Curves.
  const show = (value) => (value === null ? "none" : Number(value.toPrecision(4)).toString().replace(/-/g, "\u2212"));
  function chart(series) {
    const figure = document.createElement("figure");
    const caption = document.createElement("figcaption");
    const name = document.createElement("span");
    const value = document.createElement("b");
    const box = document.createElement("div");
    const canvas = document.createElement("canvas");
    name.textContent = series.name;
    caption.append(name, value);
    box.append(canvas);
    figure.append(caption, box);
    part("charts").append(figure);
    const known = series.values.filter((v) => v !== null);
    const low = Math.min(...known);
    const high = Math.max(...known);
    const log = known.length > 0 && low > 0 && high > 1000 * low;
    if (log) name.textContent += " (log)";
    const level = log ? Math.log10 : (v) => v;
    const made = { series: series, value: value, canvas: canvas, low: low, high: high, level: level, empty: known.length === 0 };
    const scrub = (event) => {
      const bounds = canvas.getBoundingClientRect();
      play(false);
      state.time = Math.min(1, Math.max(0, (event.clientX - bounds.left) / bounds.width)) * length;
      goTo(nearest());
    };
    canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); scrub(event); });
    canvas.addEventListener("pointermove", (event) => { if (event.buttons) scrub(event); });
    return made;
  }
  const charts = data.series.map(chart);

  function drawChart(made) {
    const scale = window.devicePixelRatio || 1;
    const [width, height] = [made.canvas.clientWidth, made.canvas.clientHeight];
    made.canvas.width = Math.round(width * scale);
    made.canvas.height = Math.round(height * scale);
    const pen = made.canvas.getContext("2d");
    const css = getComputedStyle(document.documentElement);
    const ink = (name) => css.getPropertyValue(name).trim();
    pen.scale(scale, scale);
    pen.font = "11px system-ui, sans-serif";
    const [top, bottom] = [16, height - 16];
    const [low, high] = [made.level(made.low), made.level(made.high)];
    const across = (time) => 1 + (length > 0 ? time / length : 0) * (width - 2);
    const down = (value) => (high > low ? bottom - ((made.level(value) - low) / (high - low)) * (bottom - top) : 0.5 * (top + bottom));
    pen.strokeStyle = ink("--line");
    for (const y of [top - 3, bottom + 3]) {
      pen.beginPath();
      pen.moveTo(0, y);
      pen.lineTo(width, y);
      pen.stroke();
    }
    if (!made.empty) {
      pen.fillStyle = ink("--soft");
      pen.fillText(show(made.high), 1, top - 6);
      pen.fillText(show(made.low), 1, bottom + 14);
      pen.strokeStyle = ink("--curve");
      pen.lineWidth = 1.5;
      pen.lineJoin = "round";
      pen.beginPath();
      let down_ = false;
      made.series.values.forEach((value, frame) => {
        if (value !== null) pen[down_ ? "lineTo" : "moveTo"](across(times[frame]), down(value));
        down_ = value !== null;
      });
      pen.stroke();
    }
    const frame = nearest();
    const now = made.series.values[frame];
    const x = across(state.time);
    pen.lineWidth = 1;
    pen.strokeStyle = ink("--soft");
    pen.beginPath();
    pen.moveTo(x, top - 3);
    pen.lineTo(x, bottom + 3);
    pen.stroke();
    if (now !== null) {
      pen.fillStyle = ink("--accent");
      pen.beginPath();
      pen.arc(across(times[frame]), down(now), 3.2, 0, 2 * Math.PI);
      pen.fill();
    }
    made.value.textContent = show(now);
  }

  // One picture, only when something has changed.
  function draw() {
    const [frame, share] = place(state.time);
    const shown = nearest();
    if (view) {
      view.at(frame, share);
      view.draw(Object.assign({}, shell, palettes[theme]));
    }
    part("scrub").value = shown;
    part("clock").textContent = (data.times[0] + state.time).toFixed(length < 1 ? 3 : 2) + " s";
    part("count").textContent = "frame " + data.frames[shown] + " / " + data.frames[frames - 1];
    part("caption").textContent = data.captions.length ? data.captions[shown] : "";
    charts.forEach(drawChart);
    document.documentElement.dataset.frame = data.frames[shown];
  }
  function tick(now) {
    const passed = Math.min(0.1, (now - state.last) / 1000);
    state.last = now;
    if (state.playing) {
      state.time += passed * state.speed;
      state.dirty = true;
      if (state.time >= length) {
        if (part("loop").checked) state.time %= length;
        else { state.time = length; play(false); }
      }
    }
    if (state.dirty) {
      state.dirty = false;
      draw();
    }
    requestAnimationFrame(tick);
  }

  function setTheme(name) {
    theme = name;
    document.documentElement.dataset.theme = name;
    part("theme").textContent = name === "dark" ? "Light" : "Dark";
    state.dirty = true;
  }
  const toggleTheme = () => setTheme(theme === "dark" ? "light" : "dark");
  const resetView = () => { if (view) view.camera.reset(); state.dirty = true; };

  // Switches, only for what there is.
  const has = (test) => data.tracks.some(test);
  const layers = [
    ["edges", "Mesh edges", has((track) => track.edges)],
    ["lines", "Lines", has((track) => track.lines)],
    ["contact", "Contact", has((track) => track.contact)],
    ["body", "Bodies", has((track) => track.body)],
  ];
  for (const [key, words] of layers.filter((layer) => layer[2])) {
    const label = document.createElement("label");
    const box = document.createElement("input");
    box.type = "checkbox";
    box.checked = true;
    box.addEventListener("change", () => { if (view) view.shows[key] = box.checked; state.dirty = true; });
    label.append(box, " " + words);
    if (key === "contact") label.style.setProperty("text-decoration", "underline 2px " + data.colours.contact);
    part("layers").append(label);
  }
  for (const value of speeds) part("speed").append(new Option(value + "\u00d7", value));
  part("speed").addEventListener("change", () => setSpeed(Number(part("speed").value)));
  part("scrub").max = frames - 1;
  part("scrub").addEventListener("input", () => { play(false); goTo(Number(part("scrub").value)); });
  part("play").addEventListener("click", () => play(!state.playing));
  part("theme").addEventListener("click", toggleTheme);
  part("reset").addEventListener("click", resetView);
  // After a click the keys belong to the player again, not to the button.
  document.addEventListener("click", (event) => {
    if (event.detail > 0 && event.target.matches("button, input")) event.target.blur();
  });

  const keys = {
    " ": () => play(!state.playing),
    ArrowLeft: (event) => { play(false); goTo(nearest() - (event.shiftKey ? 10 : 1)); },
    ArrowRight: (event) => { play(false); goTo(nearest() + (event.shiftKey ? 10 : 1)); },
    Home: () => { play(false); goTo(0); },
    End: () => { play(false); goTo(frames - 1); },
    "+": () => setSpeed(speeds[Math.min(speeds.length - 1, speeds.indexOf(state.speed) + 1)]),
    "-": () => setSpeed(speeds[Math.max(0, speeds.indexOf(state.speed) - 1)]),
    r: resetView,
    d: toggleTheme,
  };
  keys["="] = keys["+"];
  document.addEventListener("keydown", (event) => {
    const action = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    const busy = event.target.matches("select") || (event.key === " " && event.target.matches("button, input[type=checkbox]"));
    if (!action || busy || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    action(event);
  });

  // Pointer: one turns, with shift or the right button moves, two pinch.
  const stage = part("view");
  const down = new Map();
  const spread = () => { const [a, b] = [...down.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]); };
  stage.addEventListener("contextmenu", (event) => event.preventDefault());
  stage.addEventListener("pointerdown", (event) => {
    stage.setPointerCapture(event.pointerId);
    down.set(event.pointerId, [event.clientX, event.clientY]);
  });
  stage.addEventListener("pointermove", (event) => {
    const before = down.get(event.pointerId);
    if (!before || !view) return;
    const old = down.size === 2 ? spread() : 0;
    down.set(event.pointerId, [event.clientX, event.clientY]);
    const [dx, dy] = [event.clientX - before[0], event.clientY - before[1]];
    if (down.size === 2) {
      view.camera.scale(old / Math.max(spread(), 1));
      view.camera.pan(0.5 * dx, 0.5 * dy, stage.clientWidth, stage.clientHeight);
    } else if (event.shiftKey || event.buttons & 6) view.camera.pan(dx, dy, stage.clientWidth, stage.clientHeight);
    else view.camera.orbit(dx, dy);
    state.dirty = true;
  });
  for (const kind of ["pointerup", "pointercancel"]) stage.addEventListener(kind, (event) => down.delete(event.pointerId));
  stage.addEventListener("wheel", (event) => {
    event.preventDefault();
    if (view) view.camera.scale(Math.exp(0.001 * event.deltaY * (event.deltaMode === 1 ? 30 : 1)));
    state.dirty = true;
  }, { passive: false });
  stage.addEventListener("dblclick", resetView);
  stage.addEventListener("webglcontextlost", (event) => {
    event.preventDefault();
    view = null;
    fail(new Error("The graphics driver was reset: reload the page."));
  });
  new ResizeObserver(() => { state.dirty = true; }).observe(document.body);

  setTheme(matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
  const asked = new URLSearchParams(location.hash.slice(1));
  if (asked.has("theme")) setTheme(asked.get("theme") === "dark" ? "dark" : "light");
  setSpeed(1);
  play(!asked.has("frame") && !matchMedia("(prefers-reduced-motion: reduce)").matches);
  if (asked.has("frame")) {
    const wanted = Number(asked.get("frame")) || 0;
    goTo(Math.max(0, data.frames.findLastIndex((frame) => frame <= wanted)));
  }
  draw();
  requestAnimationFrame((now) => { state.last = now; tick(now); });
})();
