"use strict";
// A volume, turned by hand. No library and no request: all that is shown lies in this file.

const element = (id) => document.getElementById(id);
const facts = JSON.parse(element("facts").textContent);
const AXES = ["x", "y", "z"];
const TABLES = ["depth", "amplitude", "grey"];
const VIEWS = { wall: [0, 0], side: [90, 0], top: [0, 90], start: [35, 20] };
const count = AXES.map((name) => facts[name].count);
const pitch = AXES.map((name) => facts[name].pitch_m);
const first = AXES.map((name) => facts[name].first_m);
const low = first.map((at, axis) => at - pitch[axis] / 2);
const high = low.map((at, axis) => at + pitch[axis] * count[axis]);
const tables = TABLES.map((name) =>
  facts.colours[name].match(/.{6}/g).map((hex) => [0, 2, 4].map((at) => parseInt(hex.slice(at, at + 2), 16))));

const state = {
  yaw: VIEWS.start[0], pitch: VIEWS.start[1], zoom: 1, mode: "surface", colours: "depth",
  threshold: facts.threshold, near: facts.shown_m[0], far: facts.shown_m[1], plane: facts.brightest[2], moving: false,
};
let voxels = null, depths = null, graphics = null, waiting = false;

// ---- what the file holds ----

async function unpacked(id) {
  const text = atob(element(id).textContent);
  const bytes = Uint8Array.from(text, (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

const voxel = (i, j, k) => voxels[(k * count[1] + j) * count[0] + i];

function depthAt(i, j) {
  const level = depths ? depths[j * count[0] + i] : 0;
  return level ? facts.depths_m[0] + (level - 1) / 65534 * (facts.depths_m[1] - facts.depths_m[0]) : NaN;
}

// ---- the camera: parallel light, so that a length is as long anywhere ----

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

function camera() {
  const yaw = state.yaw * Math.PI / 180, tilt = state.pitch * Math.PI / 180;
  const away = [Math.sin(yaw) * Math.cos(tilt), -Math.sin(tilt), Math.cos(yaw) * Math.cos(tilt)];
  const right = [-Math.cos(yaw), 0, Math.sin(yaw)];
  const up = cross(right, away);
  const from = [Math.min(low[0], facts.wall_m[0]), Math.min(low[1], facts.wall_m[2]), 0];
  const to = [Math.max(high[0], facts.wall_m[1]), Math.max(high[1], facts.wall_m[3]), facts.shown_m[1]];
  const middle = from.map((at, axis) => (at + to[axis]) / 2);
  const reach = Math.hypot(...to.map((at, axis) => at - from[axis])) / 2;
  const { clientWidth: wide, clientHeight: tall } = element("view");
  const perPixel = reach / Math.min(wide, tall) * 2 / state.zoom;
  return { away, right, up, middle, perPixel, half: [wide * perPixel / 2, tall * perPixel / 2] };
}

// ---- the volume ----

function prepareGraphics() {
  const gl = element("volume").getContext("webgl2", { antialias: false, preserveDrawingBuffer: true });
  if (!gl) throw new Error("This browser cannot show a picture in three dimensions: WebGL 2 is off or missing.");
  if (Math.max(...count) > gl.getParameter(gl.MAX_3D_TEXTURE_SIZE)) {
    throw new Error("The volume has more voxels along an axis than this computer's graphics can hold.");
  }
  const program = gl.createProgram();
  for (const [kind, id] of [[gl.VERTEX_SHADER, "vertex"], [gl.FRAGMENT_SHADER, "fragment"]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, element(id).textContent.trim());
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
    throw new Error("The graphics of this computer refuse the drawing program: " + gl.getProgramInfoLog(program));
  }
  gl.useProgram(program);
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  const texture = (unit, target) => {
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(target, gl.createTexture());
    for (const name of ["TEXTURE_MIN_FILTER", "TEXTURE_MAG_FILTER"]) gl.texParameteri(target, gl[name], gl.LINEAR);
    for (const name of ["TEXTURE_WRAP_S", "TEXTURE_WRAP_T", "TEXTURE_WRAP_R"]) {
      gl.texParameteri(target, gl[name], gl.CLAMP_TO_EDGE);
    }
  };
  texture(0, gl.TEXTURE_3D);
  gl.texImage3D(gl.TEXTURE_3D, 0, gl.R8, ...count, 0, gl.RED, gl.UNSIGNED_BYTE, voxels);
  texture(1, gl.TEXTURE_2D);
  const colours = new Uint8Array(tables.flat(2));
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB8, tables[0].length, tables.length, 0, gl.RGB, gl.UNSIGNED_BYTE, colours);
  const at = (name) => gl.getUniformLocation(program, name);
  gl.uniform1i(at("voxels"), 0);
  gl.uniform1i(at("colours"), 1);
  gl.uniform3fv(at("low_m"), low);
  gl.uniform3fv(at("high_m"), high);
  gl.uniform3fv(at("pitch_m"), pitch);
  gl.uniform2fv(at("colours_m"), facts.depths_m);
  return { gl, at };
}

function drawVolume(seen) {
  if (!graphics) return;
  const { gl, at } = graphics, canvas = element("volume"), view = element("view");
  const scale = Math.min(window.devicePixelRatio || 1, 1.5) * (state.moving ? 0.5 : 1);
  canvas.width = Math.max(1, Math.round(view.clientWidth * scale));
  canvas.height = Math.max(1, Math.round(view.clientHeight * scale));
  gl.viewport(0, 0, canvas.width, canvas.height);
  gl.uniform1f(at("table"), (TABLES.indexOf(state.colours) + 0.5) / TABLES.length);
  gl.uniform1i(at("byDepth"), state.colours !== "amplitude");
  gl.uniform1i(at("surface"), state.mode === "surface");
  gl.uniform1i(at("onBlack"), onBlack());
  gl.uniform1f(at("threshold"), state.threshold);
  gl.uniform2f(at("cut_m"), state.near, state.far);
  gl.uniform2fv(at("half_m"), seen.half);
  for (const name of ["right", "up", "away"]) gl.uniform3fv(at(name), seen[name]);
  gl.uniform3fv(at("middle_m"), seen.middle);
  gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
}

const onBlack = () => state.colours === "amplitude";

// ---- lines and letters over it ----

function fitted(canvas, wide, tall) {
  const scale = window.devicePixelRatio || 1;
  canvas.width = Math.round(wide * scale);
  canvas.height = Math.round(tall * scale);
  const pen = canvas.getContext("2d");
  pen.scale(scale, scale);
  pen.font = "13px system-ui, sans-serif";
  pen.textBaseline = "middle";
  return pen;
}

function round(least) {
  const power = 10 ** Math.floor(Math.log10(least));
  return power * [1, 2, 5, 10].find((part) => part * power >= least * 0.999);
}

function ticks(from, to, most) {
  const step = round(Math.max((to - from) / most, 1e-6)), found = [];
  for (let k = Math.ceil(from / step - 1e-6); k * step <= to + 1e-6 * step; k++) found.push(k * step);
  return found.map((value) => [value, value.toFixed(Math.max(0, -Math.floor(Math.log10(step) + 1e-9)))]);
}

function inWords(metres) {
  return metres >= 1 ? `${+metres.toPrecision(3)} m` : metres >= 0.01 ? `${+(100 * metres).toPrecision(3)} cm`
    : `${+(1000 * metres).toPrecision(3)} mm`;
}

/** Return what writes a text at the first of its places where nothing is written yet, or nowhere. */
function writer(pen, wide, tall, ink, paper) {
  const taken = [];
  const free = ([left, top, right, bottom]) => left >= 0 && top >= 0 && right <= wide && bottom <= tall
    && taken.every(([from, above, to, below]) => right <= from || left >= to || bottom <= above || top >= below);
  return (text, places, movable = false) => {
    const half = pen.measureText(text).width / 2 + 3, high = 9;
    const inside = ([x, y]) => [clip(x, half, wide - half), clip(y, high, tall - high)];
    const boxes = places.map(movable ? inside : (place) => place)
      .map(([x, y]) => [x - half, y - high, x + half, y + high]);
    const box = boxes.find(free);
    if (!box) return;
    taken.push(box);
    const [x, y] = [(box[0] + box[2]) / 2, (box[1] + box[3]) / 2];
    pen.textAlign = "center";
    pen.lineJoin = "round";
    pen.lineWidth = 5;
    pen.strokeStyle = paper;
    pen.strokeText(text, x, y);
    pen.fillStyle = ink;
    pen.fillText(text, x, y);
  };
}

function drawLines(seen) {
  const canvas = element("lines"), { clientWidth: wide, clientHeight: tall } = canvas, dark = onBlack() && graphics;
  const pen = fitted(canvas, wide, tall), [ink, paper] = dark ? ["#fff", "#000"] : ["#1b1b1b", "#fff"];
  const flat = (p) => {
    const from = p.map((at, axis) => at - seen.middle[axis]);
    return [wide / 2 + dot(from, seen.right) / seen.perPixel, tall / 2 - dot(from, seen.up) / seen.perPixel];
  };
  const stroke = (points, width, alpha, dashes = []) => {
    pen.strokeStyle = ink;
    pen.lineWidth = width;
    pen.globalAlpha = alpha;
    pen.setLineDash(dashes);
    pen.beginPath();
    points.map(flat).forEach(([x, y], number) => (number ? pen.lineTo(x, y) : pen.moveTo(x, y)));
    pen.stroke();
    pen.globalAlpha = 1;
    pen.setLineDash([]);
  };
  const [a, b, c, d] = facts.wall_m;
  stroke([[a, c, 0], [b, c, 0], [b, d, 0], [a, d, 0], [a, c, 0]], 2.5, 0.9);
  const near = [low[0], low[1], state.near], far = [high[0], high[1], state.far], corner = [near, far];
  for (const axis of [0, 1, 2]) {
    for (const [i, j] of [[0, 0], [0, 1], [1, 0], [1, 1]]) {
      const from = [0, 0, 0];
      from[(axis + 1) % 3] = corner[i][(axis + 1) % 3];
      from[(axis + 2) % 3] = corner[j][(axis + 2) % 3];
      const to = [...from];
      from[axis] = near[axis];
      to[axis] = far[axis];
      stroke([from, to], 1, 0.3);
    }
  }
  for (const x of [near[0], far[0]]) {
    for (const y of [near[1], far[1]]) stroke([[x, y, 0], [x, y, near[2]]], 1, 0.3, [4, 4]);
  }
  const length = round(0.13 * wide * seen.perPixel), pixels = length / seen.perPixel;
  pen.fillStyle = ink;
  pen.fillRect(16, tall - 20, pixels, 4);
  const write = writer(pen, wide, tall, ink, paper);
  write(inWords(length), [[16 + pixels / 2, tall - 32]]);
  drawAxes(near, far, flat, write, stroke);
  const name = facts.wall_known ? "relay wall" : "plane of the wall", half = pen.measureText(name).width / 2;
  const corners = [[b, d, -1, -10], [b, d, 1, -10], [b, c, -1, 18], [a, d, 1, -10], [a, c, 1, 18]];
  write(name, corners.map(([atX, atY, by, down]) => {
    const [x, y] = flat([atX, atY, 0]);
    return [x + by * half, y + down];
  }), true);
}

/** Draw the edges that bear numbers, and write these before the names, which have a choice of places. */
function drawAxes(near, far, flat, write, stroke) {
  const names = [], middle = flat(near.map((at, axis) => (at + far[axis]) / 2));
  const edges = [[0, [0, near[1], near[2]]], [1, [far[0], 0, near[2]]], [2, [near[0], near[1], 0]]];
  for (const [axis, place] of edges) {
    const at = (value) => place.map((other, number) => (number === axis ? value : other));
    const [from, to] = [flat(at(near[axis])), flat(at(far[axis]))];
    const length = Math.hypot(to[0] - from[0], to[1] - from[1]);
    if (length < 60) continue;
    const across = [(from[1] - to[1]) / length, (to[0] - from[0]) / length];
    const half = [(from[0] + to[0]) / 2, (from[1] + to[1]) / 2];
    const side = Math.sign(dot([...across, 0], [half[0] - middle[0], half[1] - middle[1], 0])) || 1;
    // a label is wider than high: the more its axis stands upright, the farther away it has to be
    const beside = ([x, y], by) => [x + side * across[0] * by * 1.5, y + side * across[1] * by];
    stroke([at(near[axis]), at(far[axis])], 1.5, 0.9);
    for (const [value, text] of ticks(near[axis], far[axis], Math.min(6, length / 45))) {
      write(text, [beside(flat(at(value)), 15)]);
    }
    const along = [0.5, 0.4, 0.6, 0.3, 0.7].map((part) => from.map((start, n) => start + part * (to[n] - start)));
    names.push([`${AXES[axis]} (m)`, along.map((place) => beside(place, 36))]);
  }
  for (const [name, places] of names) write(name, places, true);
}

// ---- flat pictures: they need no graphics processor ----

function drawFlat(id, value, axisLabels = true) {
  const canvas = element(id), left = axisLabels ? 44 : 0, bottom = axisLabels ? 40 : 0, wide = canvas.clientWidth;
  const inner = wide - left, tall = inner * (high[1] - low[1]) / (high[0] - low[0]);
  canvas.style.height = `${tall + bottom}px`;
  const pen = fitted(canvas, wide, tall + bottom), image = new ImageData(count[0], count[1]);
  for (let j = 0; j < count[1]; j++) {
    for (let i = 0; i < count[0]; i++) {
      // rows from the top down, and x growing to the left
      const at = 4 * ((count[1] - 1 - j) * count[0] + count[0] - 1 - i);
      image.data.set([...value(i, j), 255], at);
    }
  }
  const small = document.createElement("canvas");
  [small.width, small.height] = count;
  small.getContext("2d").putImageData(image, 0, 0);
  pen.fillStyle = "#fff";
  pen.fillRect(0, 0, wide, tall + bottom);
  pen.imageSmoothingEnabled = false;
  pen.drawImage(small, left, 0, inner, tall);
  pen.fillStyle = "#1b1b1b";
  pen.textAlign = "center";
  const x = (at) => left + (high[0] - at) / (high[0] - low[0]) * inner;
  const y = (at) => (high[1] - at) / (high[1] - low[1]) * tall;
  for (const [at, text] of ticks(low[0], high[0], Math.min(5, inner / 60))) {
    pen.fillRect(x(at), tall, 1, 4);
    pen.fillText(text, Math.min(x(at), wide - 14), tall + 13);
  }
  pen.fillText("\u2190 x (m), as seen from the wall", left + inner / 2, tall + 30);
  pen.textAlign = "right";
  for (const [at, text] of ticks(low[1], high[1], 5)) {
    pen.fillRect(left - 4, y(at), 4, 1);
    pen.fillText(text, left - 7, Math.max(y(at), 8));
  }
  canvas.onpointermove = (event) => {
    const box = canvas.getBoundingClientRect();
    const i = Math.floor((1 - (event.clientX - box.left - left) / inner) * count[0]);
    const j = Math.floor((1 - (event.clientY - box.top) / tall) * count[1]);
    if (i >= 0 && i < count[0] && j >= 0 && j < count[1]) element("reading").textContent = reading(i, j);
  };
}

function brightest(i, j) {
  let greatest = 0, plane = 0;
  for (let k = 0; k < count[2]; k++) {
    if (voxel(i, j, k) > greatest) [greatest, plane] = [voxel(i, j, k), k];
  }
  return [greatest, plane];
}

function reading(i, j) {
  const [greatest, plane] = brightest(i, j), surface = depthAt(i, j);
  const place = `x ${(first[0] + i * pitch[0]).toFixed(3)} m, y ${(first[1] + j * pitch[1]).toFixed(3)} m`;
  const depth = Number.isNaN(surface) ? "no surface" : `surface at z ${surface.toFixed(3)} m`;
  return `${place}: brightest at z ${(first[2] + plane * pitch[2]).toFixed(2)} m, ${(greatest / 255).toFixed(2)} of the maximum; ${depth}.`;
}

function drawSlices() {
  const colours = tables[TABLES.indexOf("amplitude")], last = colours.length - 1;
  const bright = (value) => colours[Math.round(value / 255 * last)];
  drawFlat("slice", (i, j) => bright(voxel(i, j, state.plane)));
  drawFlat("front", (i, j) => bright(brightest(i, j)[0]));
  element("depths").hidden = !depths;
  if (!depths) return;
  const scale = tables[TABLES.indexOf(state.colours === "grey" ? "grey" : "depth")], ends = facts.depths_m;
  drawFlat("depth", (i, j) => {
    const z = depthAt(i, j);
    return Number.isNaN(z) ? [240, 240, 240] : scale[Math.round((z - ends[0]) / (ends[1] - ends[0]) * last)];
  });
  const bar = element("bar").getContext("2d");
  for (let i = 0; i < 256; i++) {
    bar.fillStyle = `rgb(${scale[Math.round(i / 255 * last)].join(",")})`;
    bar.fillRect(i, 0, 1, 1);
  }
  [element("least").textContent, element("most").textContent] = ends.map((z) => `${z.toFixed(2)} m`);
}

// ---- what the hands do ----

function draw() {
  if (waiting) return;
  waiting = true;
  requestAnimationFrame(() => {
    waiting = false;
    const seen = camera();
    drawVolume(seen);
    drawLines(seen);
  });
}

let settled = 0;
function move() {
  state.moving = true;
  clearTimeout(settled);
  settled = setTimeout(() => { state.moving = false; draw(); }, 180);
  draw();
}

function show() {
  for (const id of ["mode", "colours", "threshold", "near", "far", "plane"]) element(id).value = state[id];
  const say = (id, text) => { document.querySelector(`output[for=${id}]`).textContent = text; };
  say("threshold", `${state.threshold.toFixed(2)} of max.`);
  say("near", `${state.near.toFixed(2)} m`);
  say("far", `${state.far.toFixed(2)} m`);
  say("plane", `${(first[2] + state.plane * pitch[2]).toFixed(2)} m`);
  draw();
}

function set(name, value) {
  state[name] = value;
  if (name === "near") state.far = Math.max(state.far, value + pitch[2]);
  if (name === "far") state.near = Math.min(state.near, value - pitch[2]);
  show();
  if (voxels && (name === "plane" || name === "colours")) drawSlices();
}

const next = (id) => {
  const options = [...element(id).options];
  return options[(options.findIndex((option) => option.value === state[id]) + 1) % options.length].value;
};
const turn = (yaw, tilt) => {
  state.yaw = (state.yaw + yaw) % 360;
  state.pitch = Math.max(-90, Math.min(90, state.pitch + tilt));
  move();
};
const zoom = (factor) => { state.zoom = Math.max(0.4, Math.min(20, state.zoom * factor)); move(); };
const look = (name) => { [state.yaw, state.pitch] = VIEWS[name]; if (name === "start") state.zoom = 1; draw(); };
const clip = (value, least, most) => Math.max(least, Math.min(most, value));

const KEYS = {
  1: () => look("wall"), 2: () => look("side"), 3: () => look("top"), 0: () => look("start"),
  m: () => set("mode", next("mode")), c: () => set("colours", next("colours")),
  "[": () => set("threshold", clip(state.threshold - 0.02, 0.01, 1)),
  "]": () => set("threshold", clip(state.threshold + 0.02, 0.01, 1)),
  ",": () => set("plane", clip(state.plane - 1, 0, count[2] - 1)),
  ".": () => set("plane", clip(state.plane + 1, 0, count[2] - 1)),
  "+": () => zoom(1.15), "=": () => zoom(1.15), "-": () => zoom(1 / 1.15),
};
const ARROWS = { ArrowLeft: [5, 0], ArrowRight: [-5, 0], ArrowUp: [0, -5], ArrowDown: [0, 5] };

function listen() {
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
    const act = KEYS[event.key], arrow = event.target === element("lines") && ARROWS[event.key];
    if (!act && !arrow) return;
    event.preventDefault();
    if (act) act(); else turn(...arrow);
  });
  document.querySelectorAll("[data-view]").forEach((button) => { button.onclick = () => look(button.dataset.view); });
  for (const id of ["mode", "colours"]) element(id).onchange = (event) => set(id, event.target.value);
  for (const id of ["threshold", "near", "far", "plane"]) element(id).oninput = (event) => set(id, Number(event.target.value));
  for (const id of ["near", "far"]) Object.assign(element(id), { min: low[2], max: high[2], step: pitch[2] });
  element("plane").max = count[2] - 1;
  const canvas = element("lines"), fingers = new Map();
  canvas.onpointerdown = (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
  };
  canvas.onpointerup = canvas.onpointercancel = (event) => fingers.delete(event.pointerId);
  canvas.onpointermove = (event) => {
    const before = fingers.get(event.pointerId), now = [event.clientX, event.clientY];
    if (!before) return;
    if (fingers.size === 1) {
      turn((before[0] - now[0]) * 0.5, (now[1] - before[1]) * 0.5);
    } else {
      const [other] = [...fingers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
      const apart = (place) => Math.hypot(place[0] - other[0], place[1] - other[1]);
      zoom(apart(now) / Math.max(apart(before), 1));
    }
    fingers.set(event.pointerId, now);
  };
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(Math.exp(-event.deltaY * 0.001));
  }, { passive: false });
  new ResizeObserver(() => { draw(); if (voxels) drawSlices(); }).observe(element("view"));
}

/** Take a view from the address, e.g. page.html#view=wall&mode=maximum&threshold=0.3 */
function readAddress() {
  for (const [name, value] of new URLSearchParams(location.hash.slice(1))) {
    if (name === "view" && VIEWS[value]) [state.yaw, state.pitch] = VIEWS[value];
    if (["mode", "colours"].includes(name) && [...element(name).options].some((one) => one.value === value)) state[name] = value;
    if (["threshold", "near", "far", "zoom"].includes(name) && Number(value) > 0) state[name] = Number(value);
  }
}

async function start() {
  readAddress();
  listen();
  show();
  if (!window.DecompressionStream) throw new Error("This browser is too old to unpack the volume: use one of 2023 or later.");
  const found = await unpacked("voxels");
  if (found.length !== count[0] * count[1] * count[2]) throw new Error("The file is damaged: voxels are missing.");
  voxels = found;
  const levels = await unpacked("surface");
  depths = levels.length ? new Uint16Array(levels.buffer) : null;
  drawSlices();
  graphics = prepareGraphics();
  element("message").textContent = facts.signal ? "" : "No signal above noise.";
}

start().catch((error) => {
  const below = voxels ? " Slices, front view and depths below need none." : "";
  element("message").textContent = error.message + below;
}).finally(() => {
  show();
  requestAnimationFrame(() => requestAnimationFrame(() => {
    document.documentElement.dataset.shown = graphics ? "volume" : voxels ? "slices" : "nothing";
  }));
});
