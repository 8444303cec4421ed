// Shows a scan that runs. It asks for the state again and again; each answer comes as soon as there is a
// newer one. All words are made by the program that is asked, and put here as text.

import { drawCurve, drawHistogram, drawImage } from "./plots.js";

// An answer comes within 2 s, if only to say that nothing is new; without any for so long, nothing is heard.
const SILENT_MS = 5000;
const GIVE_UP_MS = 8000;
const AGAIN_MS = 1000;
const SIGNS = { on: "\u25CF", dark: "\u25CB", unknown: "\u25B2", unsaid: "?" };

const at = (id) => document.getElementById(id);
let state = null;
let version = "";
let heardMs = null; // of the newest answer, by this computer's clocks: one may stand while the computer sleeps
let heardDateMs = 0;
let heardS = 0; // the same by the clock of the program that is asked
let refused = "";

function put(id, text) {
  const element = at(id);
  if (element.textContent !== text) element.textContent = text;
}

function put_list(list, pairs) {
  const wanted = pairs.map((pair) => pair.join("\n")).join("\n\n");
  if (list.dataset.shown === wanted) return;
  list.dataset.shown = wanted;
  list.replaceChildren(...pairs.map(([name, text]) => {
    const group = document.createElement("div");
    const term = document.createElement("dt");
    const said = document.createElement("dd");
    term.textContent = name;
    said.textContent = text;
    group.append(term, said);
    return group;
  }));
}

/** The time of day of seconds since 1970, where the scan runs. */
function clock(seconds) {
  return new Date((seconds + state.utc_offset_s) * 1000).toISOString().slice(11, 19);
}

const silentMs = () => Math.max(performance.now() - heardMs, Date.now() - heardDateMs);
const silent = () => heardMs !== null && silentMs() > SILENT_MS;

function showLight() {
  const light = state.light;
  let [kind, words, from] = [light.is, light.words, light.from];
  if (silent()) {
    const dark = state.end !== null && kind === "dark";
    kind = dark ? "unsaid" : "unknown";
    words = dark ? "Light not known now: the scan is over" : "LIGHT NOT KNOWN NOW: treat the laser as EMITTING";
    from = `reported at ${clock(heardS)}: ${light.last}`;
  }
  at("light").className = `light ${kind}${state.scan.reads || silent() ? " old" : ""}`;
  put("light-sign", SIGNS[kind]);
  put("light-words", words);
  put("light-from", from);
}

function showConnection() {
  const lost = at("lost");
  const was = lost.hidden;
  lost.hidden = !(refused || silent());
  if (refused) put("lost", refused);
  else if (silent()) {
    put("lost", state.end
      ? `The page has not been served since ${clock(heardS)}: the scan is over, and this is the last report.`
      : `Connection lost since ${clock(heardS)}. This page shows the state at that time, not now.`);
  }
  if (was !== lost.hidden) document.body.classList.toggle("old", !lost.hidden);
}

function showAge() {
  if (!state) return;
  const nowS = heardS + silentMs() / 1000;
  const ago = (seconds) => {
    const passed = Math.max(0, nowS - seconds);
    return passed < 2 ? "just now" : passed < 120 ? `${Math.round(passed)} s ago` : `at ${clock(seconds)}`;
  };
  const told = [];
  if (state.newest_s !== null) told.push(`newest photons ${ago(state.newest_s)}`);
  if (!state.end) told.push(`${state.scan.reads ? "file last changed" : "last message from the scan"} ${ago(state.heard_s)}`);
  put("age", told.join(", "));
}

function showProgress() {
  const part = state.progress.part;
  put("progress", state.progress.words);
  put("phase", state.phase);
  const bar = at("bar");
  bar.hidden = part === null;
  if (part !== null) {
    at("bar-done").style.width = `${100 * part}%`;
    bar.setAttribute("aria-valuenow", String(Math.round(100 * part)));
  }
  put_list(at("numbers"), state.numbers);
  at("end").hidden = state.end === null;
  if (state.end) {
    put("end-words", state.end.words);
    at("end-next").hidden = !state.end.next;
    put("end-command", state.end.next);
  }
  at("stop-line").hidden = !state.stop.possible;
  at("stop").disabled = state.stop.asked !== null;
  if (state.stop.asked) put("stop-said", `requested at ${state.stop.asked}: the scan stops after this position`);
  const sign = silent() ? SIGNS.unknown : SIGNS[state.light.is];
  document.title = `${sign} ${state.progress.part === null ? "" : `${Math.floor(100 * part)} % `}${state.scan.name}`;
}

function showWarnings() {
  const list = at("warnings");
  const lines = state.warnings.map((one) =>
    [one.when, one.kind === "warning" ? "" : `${one.kind}:`, `${one.where}: ${one.sentence}`]
      .filter(Boolean).join(" "));
  if (!lines.length) lines.push("none");
  const wanted = lines.join("\n");
  if (list.dataset.shown === wanted) return;
  list.dataset.shown = wanted;
  list.replaceChildren(...lines.map((line) => {
    const item = document.createElement("li");
    item.textContent = line;
    return item;
  }));
}

function showPictures() {
  const { colours } = state.scan;
  const { wall, picture, histogram, rates } = state;
  drawImage(at("wall"), wall, colours.counts, { label: "photons", note: wall.note });
  put("wall-said", `${wall.said}. Light grey: not measured.`);
  drawImage(at("front"), picture?.front, colours.amplitude, {
    label: "amplitude / maximum", note: picture?.empty ? "no signal above noise" : "",
  });
  put("front-title", picture ? upper(picture.title) : "Live image");
  put("front-said", picture ? `Wavelength ${picture.wavelength}. ${picture.said}` : "Not yet.");
  drawImage(at("depth"), picture?.depth, colours.depth, { label: "depth z (m)", note: "" });
  put("depth-said", picture ? "Light grey: no surface." : "Not yet.");
  drawHistogram(at("histogram"), histogram, picture?.imaged_ns);
  put("histogram-said", histogram ? histogramInWords(histogram, picture) : "No photons yet.");
  drawCurve(at("rates"), rates);
  put("rates-said", rates ? `The newest: ${rates.photons_per_s.at(-1).toLocaleString("en")} photons/s.` : "Not yet.");
}

const upper = (text) => text.charAt(0).toUpperCase() + text.slice(1);

function histogramInWords(histogram, picture) {
  const told = histogram.gate.map((edge) => `${edge.name} at ${((edge.ns[0] + edge.ns[1]) / 2).toFixed(1)} ns`);
  if (picture) told.push(`imaged: ${picture.imaged_ns.map((ns) => ns.toFixed(1)).join(" to ")} ns`);
  return `${upper(told.join(", "))}${told.length ? ". " : ""}Time since the pulse was on the wall.`;
}

function show() {
  put("name", state.scan.name);
  put_list(at("facts"), state.scan.facts);
  showLight();
  showProgress();
  showWarnings();
  showPictures();
}

/** Say how old all is; the rest changes with answers only. */
function tick() {
  if (state) {
    showLight();
    showAge();
  }
  showConnection();
}

/** Ask for what is newer than what is here; return whether there was an answer. */
async function ask() {
  const answer = await fetch(`state?have=${version}`, {
    cache: "no-store", credentials: "same-origin", signal: AbortSignal.timeout(GIVE_UP_MS),
  });
  if (answer.status === 403) {
    refused = await answer.text();
    return false;
  }
  if (!answer.ok) return false;
  const fresh = answer.status === 200 ? await answer.json() : null;
  refused = "";
  heardMs = performance.now();
  heardDateMs = Date.now();
  heardS = Number(answer.headers.get("Rig-Now"));
  version = answer.headers.get("Rig-Version");
  if (fresh) {
    state = fresh;
    show();
  }
  return true;
}

async function listen() {
  for (;;) {
    let answered = false;
    try {
      answered = await ask();
    } catch {
      // nobody answers: that is said by how long it lasts
    }
    tick();
    if (!answered) await new Promise((resolve) => setTimeout(resolve, AGAIN_MS));
  }
}

async function stop() {
  at("sure").close();
  put("stop-said", "asking …");
  try {
    const answer = await fetch("stop", { method: "POST", credentials: "same-origin" });
    put("stop-said", await answer.text());
  } catch {
    put("stop-said", "nobody answered: the scan was not stopped from here");
  }
}

at("stop").addEventListener("click", () => at("sure").showModal());
at("sure-no").addEventListener("click", () => at("sure").close());
at("sure-yes").addEventListener("click", stop);
addEventListener("resize", () => state && showPictures());
if (location.search) history.replaceState(null, "", location.pathname); // the token is a cookie now
setInterval(tick, 500);
listen();
