// Images and curves on canvases, with axes. Images are seen as the virtual camera sees them: y up, x growing
// to the left.

const INK = "#1c2430";
const MUTED = "#4c5764";
const LINE = "#20639b";
const EDGE = "#b35900";
const NOTHING = "#f0f0f0";
const FONT_PX = 12;
const images = new Map(); // the newest image of each canvas, and what it was made of

/** Make a canvas as fine as the screen, and return what draws on it, its width and its height. */
function prepare(canvas) {
  const scale = devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  const [wide, high] = [Math.round(width * scale), Math.round(height * scale)];
  if (canvas.width !== wide) canvas.width = wide;
  if (canvas.height !== high) canvas.height = high;
  const pen = canvas.getContext("2d");
  pen.setTransform(scale, 0, 0, scale, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.font = `${FONT_PX}px system-ui, sans-serif`;
  pen.lineWidth = 1;
  return { pen, width, height };
}

/** About `count` round numbers from `low` to `high`. */
export function ticks(low, high, count) {
  const raw = (high - low) / Math.max(1, count);
  if (!(raw > 0)) return [low];
  const size = 10 ** Math.floor(Math.log10(raw));
  const step = size * [1, 2, 5, 10].find((one) => one * size >= raw * 0.999);
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const found = [];
  for (let n = Math.ceil(low / step - 1e-9); n * step <= high + 1e-9 * step; n += 1) {
    found.push(Number((n * step).toFixed(digits)));
  }
  return found;
}

const labels = (values) => {
  const digits = Math.max(...values.map((value) => (String(value).split(".")[1] ?? "").length));
  return values.map((value) => (Math.abs(value) >= 1e4 ? value.toLocaleString("en") : value.toFixed(digits)));
};

const powers = (power) => [...String(power)].map((digit) => "\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079"[digit]).join("");

function write(pen, text, x, y, align = "left", baseline = "alphabetic", colour = INK) {
  pen.fillStyle = colour;
  pen.textAlign = align;
  pen.textBaseline = baseline;
  pen.fillText(text, x, y);
}

function upright(pen, text, x, y) {
  pen.save();
  pen.translate(x, y);
  pen.rotate(-Math.PI / 2);
  write(pen, text, 0, 0, "center", "middle", MUTED);
  pen.restore();
}

/** Draw a box with ticks below and to the left; `place` maps values to pixels. */
function axes(pen, box, across, up) {
  pen.strokeStyle = MUTED;
  pen.strokeRect(box.left + 0.5, box.top + 0.5, box.width, box.height);
  const bottom = box.top + box.height;
  across.names.forEach((name, n) => {
    const x = across.place(across.values[n]);
    line(pen, x, bottom, x, bottom + 4, MUTED);
    write(pen, name, x, bottom + 6, "center", "top");
  });
  up.names.forEach((name, n) => {
    const y = up.place(up.values[n]);
    line(pen, box.left - 4, y, box.left, y, MUTED);
    write(pen, name, box.left - 6, y, "right", "middle");
  });
  write(pen, across.label, box.left + box.width / 2, bottom + 22, "center", "top", MUTED);
  upright(pen, up.label, up.labelAt ?? box.left - 42, box.top + box.height / 2);
}

function line(pen, fromX, fromY, toX, toY, colour, dash = []) {
  pen.strokeStyle = colour;
  pen.setLineDash(dash);
  pen.beginPath();
  pen.moveTo(fromX, fromY);
  pen.lineTo(toX, toY);
  pen.stroke();
  pen.setLineDash([]);
}

function saying(canvas, words) {
  const { pen, width, height } = prepare(canvas);
  pen.fillStyle = NOTHING;
  pen.fillRect(0, 0, width, height);
  write(pen, words, width / 2, height / 2, "center", "middle", MUTED);
}

const colour = (table, level) => {
  const count = table.length / 6;
  const at = 6 * Math.round(((level - 1) / 254) * (count - 1));
  return [0, 2, 4].map((n) => parseInt(table.slice(at + n, at + n + 2), 16));
};

/** The pixels of an image, x growing to the left and y up, on a canvas of their own. */
function pixels(canvas, image, table) {
  const kept = images.get(canvas);
  if (kept && kept.levels === image.levels && kept.table === table) return kept.drawn;
  const [columns, rows] = [image.x.count, image.y.count];
  const drawn = document.createElement("canvas");
  drawn.width = columns;
  drawn.height = rows;
  const pen = drawn.getContext("2d");
  const data = pen.createImageData(columns, rows);
  const levels = Uint8Array.from(atob(image.levels), (letter) => letter.charCodeAt(0));
  const colours = Array.from({ length: 256 }, (_, level) => (level ? colour(table, level) : [240, 240, 240]));
  for (let row = 0; row < rows; row += 1) {
    for (let column = 0; column < columns; column += 1) {
      const place = 4 * ((rows - 1 - row) * columns + (columns - 1 - column));
      const [red, green, blue] = colours[levels[row * columns + column]];
      data.data.set([red, green, blue, 255], place);
    }
  }
  pen.putImageData(data, 0, 0);
  images.set(canvas, { levels: image.levels, table, drawn });
  return drawn;
}

/** Draw an image to scale, with axes in metres and a bar of colours. */
export function drawImage(canvas, image, table, { label, note }) {
  if (!image) {
    saying(canvas, "not yet");
    return;
  }
  const room = { left: 52, top: 8, right: 72, bottom: 42 };
  const [wideM, highM] = [image.x, image.y].map((axis) => axis.count * axis.pitch_m);
  const most = { width: canvas.clientWidth - room.left - room.right, height: 1.2 * canvas.clientWidth };
  const scale = Math.min(most.width / wideM, most.height / highM);
  canvas.style.height = `${Math.round(highM * scale) + room.top + room.bottom}px`; // as high as the wall
  const { pen } = prepare(canvas);
  const box = { left: room.left, top: room.top, width: wideM * scale, height: highM * scale };
  box.left += (most.width - box.width) / 2;
  const [firstX, firstY] = [image.x, image.y].map((axis) => axis.first_m - axis.pitch_m / 2);
  pen.imageSmoothingEnabled = false;
  pen.drawImage(pixels(canvas, image, table), box.left, box.top, box.width, box.height);
  const x = ticks(firstX, firstX + wideM, Math.max(4, box.width / 70));
  const y = ticks(firstY, firstY + highM, Math.max(2, box.height / 50));
  axes(pen, box,
    { values: x, names: labels(x), label: "\u2190 x (m), as seen from the wall",
      place: (value) => box.left + box.width - (value - firstX) * scale },
    { values: y, names: labels(y), label: "y (m)", labelAt: box.left - 42,
      place: (value) => box.top + box.height - (value - firstY) * scale });
  drawBar(pen, box, image, table, label);
  if (note) {
    pen.fillStyle = "rgb(255 255 255 / 85%)";
    pen.fillRect(box.left + 4, box.top + box.height - 22, pen.measureText(note).width + 10, 18);
    write(pen, note, box.left + 9, box.top + box.height - 13, "left", "middle");
  }
}

function drawBar(pen, box, image, table, label) {
  const [left, wide] = [box.left + box.width + 8, 10];
  for (let n = 0; n < box.height; n += 1) {
    pen.fillStyle = `rgb(${colour(table, 255 - (254 * n) / box.height).join(" ")})`;
    pen.fillRect(left, box.top + n, wide, 1.5);
  }
  const values = ticks(image.low, image.high, Math.max(2, box.height / 50));
  labels(values).forEach((name, n) => {
    const y = box.top + box.height * (1 - (values[n] - image.low) / (image.high - image.low));
    write(pen, name, left + wide + 4, y, "left", "middle");
  });
  upright(pen, label, left + wide + 46, box.top + box.height / 2);
}

/** Draw photons over time, on a logarithmic scale, with the gate and what is imaged. */
export function drawHistogram(canvas, histogram, imagedNs) {
  if (!histogram) {
    saying(canvas, "no photons yet");
    return;
  }
  const { pen, width, height } = prepare(canvas);
  const box = { left: 62, top: 22, width: width - 76, height: height - 64 };
  const { first_ns: first, width_ns: bin, photons } = histogram;
  const last = first + bin * photons.length;
  const most = Math.max(...photons);
  const top = Math.log10(Math.max(10, 3 * most));
  const bottom = Math.log10(0.7);
  const placeX = (ns) => box.left + ((ns - first) / (last - first)) * box.width;
  const placeY = (count) => box.top + box.height * (1 - (Math.log10(Math.max(count, 0.7)) - bottom) / (top - bottom));
  const within = (ns) => Math.min(Math.max(placeX(ns), box.left), box.left + box.width);
  if (imagedNs) {
    const [from, to] = imagedNs.map(within);
    pen.fillStyle = "#dbe8f4";
    pen.fillRect(from, box.top, to - from, box.height);
    if (to - from > 50) write(pen, "imaged", (from + to) / 2, box.top - 4, "center", "bottom", LINE);
    for (const edge of [from, to]) line(pen, edge, box.top, edge, box.top + box.height, LINE, [1, 3]);
  }
  pen.strokeStyle = LINE;
  pen.beginPath();
  photons.forEach((count, n) => {
    pen.lineTo(placeX(first + n * bin), placeY(count));
    pen.lineTo(placeX(first + (n + 1) * bin), placeY(count));
  });
  pen.stroke();
  histogram.gate.forEach(({ name, ns }, n) => {
    const middle = placeX((ns[0] + ns[1]) / 2);
    if (middle < box.left || middle > box.left + box.width) return;
    pen.fillStyle = "rgb(179 89 0 / 20%)";
    pen.fillRect(within(ns[0]), box.top, within(ns[1]) - within(ns[0]), box.height);
    line(pen, middle, box.top, middle, box.top + box.height, EDGE, [5, 3]);
    write(pen, name, middle + (n ? -4 : 4), box.top + 6, n ? "right" : "left", "top", EDGE);
  });
  const x = ticks(first, last, box.width / 80);
  const y = Array.from({ length: Math.floor(top) + 1 }, (_, power) => 10 ** power);
  axes(pen, box,
    { values: x, names: labels(x), label: "time after the pulse on the wall (ns)", place: placeX },
    { values: y, names: y.map((value) => `10${powers(Math.round(Math.log10(value)))}`), label: `photons in ${(1e3 * bin).toPrecision(3)} ps`,
      labelAt: 9, place: placeY });
}

/** Draw a rate over time. */
export function drawCurve(canvas, rates) {
  if (!rates) {
    saying(canvas, "not yet");
    return;
  }
  const { pen, width, height } = prepare(canvas);
  const box = { left: 62, top: 8, width: width - 76, height: height - 50 };
  const lastS = Math.max(rates.s.at(-1), 1);
  const [unit, name] = lastS < 180 ? [1, "s"] : lastS < 10800 ? [60, "min"] : [3600, "h"];
  const top = 1.15 * Math.max(...rates.photons_per_s, 1);
  const placeX = (value) => box.left + ((value * unit) / lastS) * box.width;
  const placeY = (value) => box.top + box.height * (1 - value / top);
  pen.strokeStyle = LINE;
  pen.lineWidth = 1.5;
  pen.beginPath();
  rates.s.forEach((second, n) => pen.lineTo(placeX(second / unit), placeY(rates.photons_per_s[n])));
  pen.stroke();
  pen.lineWidth = 1;
  const x = ticks(0, lastS / unit, Math.max(2, box.width / 80));
  const y = ticks(0, top, Math.max(2, box.height / 45));
  const thousands = top > 5000;
  axes(pen, box,
    { values: x, names: labels(x), label: `time since the first photons (${name})`, place: placeX },
    { values: y, names: labels(y.map((value) => (thousands ? value / 1000 : value))),
      label: thousands ? "thousand photons/s" : "photons/s", labelAt: 9, place: placeY });
}
