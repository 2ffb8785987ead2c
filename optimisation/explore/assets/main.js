import { Plot, csvOf, digits, save, savePng, svgOf } from "./figure.js";
import { Motion } from "./motion.js";

const $ = (wanted) => document.querySelector(wanted);
const table = await (await fetch("controls")).json();
const controls = new Map(table.controls.map((control) => [control.name, control]));
const panels = { curve: $("#curve"), sweep: $("#sweep"), motion: $("#motion"), response: $("#response"), card: $("#card") };
const LINES = { none: "no absorber", limit: "limit", friction: "friction damper", tuned: "tuned absorber" };
const WORDS = { none: "curve without absorber", friction: "friction damper's curve", tuned: "tuned absorber's curve" };
const values = {}, rows = new Map();
let socket, number = 0, since = { load: "", number: 0 }, sent = 0, measured = {}, wanted = false, shown = {};
// what is drawn: of one number each, never an older one over a newer
const known = { curve: null, old: null, lines: {}, sweep: null, response: null, card: null, scene: null, command: "" };

// controls

const SLIDES = 1000;
const toSlider = (c, v) => c.whole ? v : c.log ? (v <= 0 ? 0 : (c.zero ? 20 : 0) + (SLIDES - (c.zero ? 20 : 0)) * Math.log(v / c.low) / Math.log(c.high / c.low)) : (SLIDES * (v - c.low)) / (c.high - c.low);
const fromSlider = (c, s) => {
  if (c.whole) return s;
  if (!c.log) return Number((c.low + ((c.high - c.low) * s) / SLIDES).toPrecision(4));
  const from = c.zero ? 20 : 0;
  return s < from ? 0 : Number((c.low * (c.high / c.low) ** ((s - from) / (SLIDES - from))).toPrecision(3));
};

function makeControls() {
  for (const [id, words] of [["concept", table.concepts], ["load", table.loads], ["direction", table.directions]]) {
    for (const [value, label] of Object.entries(words)) $(`#${id}`).append(new Option(label, value));
    $(`#${id}`).addEventListener("change", (event) => { values[id] = event.target.value; changed(); });
    values[id] = Object.keys(words)[0];
  }
  for (const c of table.controls) {
    const row = document.createElement("div"), label = document.createElement("label"), unit = document.createElement("span"), exact = document.createElement("input"), slider = document.createElement("input"), error = document.createElement("p");
    row.className = "row"; row.dataset.control = c.name;
    label.htmlFor = exact.id = `n-${c.name}`; label.textContent = `${c.label} `;
    unit.className = "unit"; unit.textContent = c.unit; label.append(unit);
    Object.assign(exact, { type: "number", step: "any", inputMode: "decimal" });
    Object.assign(slider, { type: "range", min: c.whole ? c.low : 0, max: c.whole ? c.high : SLIDES, step: 1 });
    slider.setAttribute("aria-label", `${c.label}${c.unit ? `, ${c.unit}` : ""}`);
    error.className = "error"; error.id = `e-${c.name}`; error.setAttribute("role", "alert");
    exact.setAttribute("aria-describedby", error.id);
    row.append(label, exact, slider, error);
    slider.addEventListener("input", () => { set(c.name, fromSlider(c, Number(slider.value)), slider); changed(); });
    exact.addEventListener("change", () => { set(c.name, exact.value.trim() === "" ? null : Number((Number(exact.value) / c.per).toPrecision(15)), exact); changed(); });
    $("#numbers").append(row);
    rows.set(c.name, { row, exact, slider, error, unit });
    set(c.name, c.value);
  }
}

function set(name, value, from) {
  const c = controls.get(name), { row, exact, slider, unit } = rows.get(name);
  values[name] = value;
  if (from !== exact) exact.value = value === null ? "" : Number((value * c.per).toPrecision(6));
  if (from !== slider && Number.isFinite(value)) slider.value = toSlider(c, value);
  slider.setAttribute("aria-valuetext", `${exact.value} ${c.unit}`);
  if (name === "mass_ratio") unit.textContent = `${c.unit}${Number.isFinite(value) ? `, ${digits(value * table.beam_mass_kg, 3)} kg` : ""}`;
  row.hidden = false;
}

function showForConcept() {
  for (const [name, { row }] of rows) {
    const c = controls.get(name), meant = (names, value) => !names.length || names.includes(value);
    row.style.display = meant(c.concepts, values.concept) && meant(c.loads, values.load) ? "" : "none";
  }
  for (const id of ["concept", "load", "direction"]) $(`#${id}`).value = values[id];
  $("#direction").disabled = values.load === "random";
  $("#recommend").disabled = values.concept === "none" || (values.concept === "friction" && values.load === "random");
}

function toAddress() {
  const words = new URLSearchParams();
  for (const [name, value] of Object.entries(values)) {
    const usual = controls.has(name) ? controls.get(name).value : name === "instant" ? null : Object.keys(table[`${name}s`])[0];
    if (value !== usual && value !== undefined && value !== null) words.set(name, value);
  }
  history.replaceState(null, "", words.size ? `#${words}` : location.pathname);
}

function fromAddress() {
  const words = new URLSearchParams(location.hash.slice(1));
  for (const c of table.controls) set(c.name, words.has(c.name) ? Number(words.get(c.name)) : c.value);
  for (const id of ["concept", "load", "direction"]) values[id] = words.get(id) in table[`${id}s`] ? words.get(id) : Object.keys(table[`${id}s`])[0];
  values.instant = words.has("instant") ? Number(words.get("instant")) : null;
}

function changed(keepInstant = false) {
  if (!keepInstant) values.instant = null;
  showForConcept();
  toAddress();
  $("#why").textContent = "";
  if (wanted) return;
  wanted = true;
  requestAnimationFrame(() => { wanted = false; ask(); });
}

function ask(extra = {}) {
  if (socket?.readyState !== WebSocket.OPEN) return;
  number += 1;
  if (values.load !== since.load) { since = { load: values.load, number }; known.curve = known.old = null; } // another unit
  sent = performance.now();
  for (const panel of Object.values(panels)) if (!extra.recommend) panel.classList.add("older");
  say(extra.recommend ? "asking for advice" : "computing");
  socket.send(JSON.stringify({ number, values, ...extra }));
  document.documentElement.dataset.asked = number;
}

const say = (text) => { $("#status").textContent = text; };

// messages

const take = {
  taken(m) { known.scene = m.scene; known.load = m.load; known.command = m.command; $("[data-save=load]").hidden = !m.load; $("#command").textContent = m.command; showErrors({}); },
  refused(m) { showErrors(m.errors); say("not computed: a value is not allowed"); },
  failed(m) { showErrors({ "": m.error }); say("this could not be computed"); },
  compiling(m) {
    const panel = m.what in panels ? m.what : "curve", seconds = m.seconds === null ? "" : `compiling, ${m.seconds.toFixed(0)} s`;
    note(panel, seconds);
    panels[panel].querySelector(".plot").dataset.waits = seconds && `${seconds}: the kernels of this kind of absorber, once`;
    say(m.seconds === null ? "computing" : `compiling for the ${WORDS[m.what] ?? m.what}: once for each kind of absorber, up to a minute`);
  },
  advice(m) {
    $("#progress").hidden = m.values !== undefined;
    if (m.values === undefined) { $("#progress").value = m.done / m.total; return; }
    for (const [name, value] of Object.entries(m.values)) set(name, Number(value.toPrecision(4)));
    changed();
    $("#why").textContent = m.why;
  },
  curve(m) {
    const fresh = shown.curve !== m.number;
    if (fresh) { known.old = known.curve; known.curve = { points: new Map() }; known.lines = {}; }
    m.force.forEach((force, k) => {
      const before = known.curve.points.get(force), point = { rough: m.rough, members: m.members };
      for (const name of ["both", "low", "high", "up", "down"]) point[name] = m[name][k];
      if (point.both === null && point.up === null && point.down === null) return;
      if (!before || before.rough || !m.rough) known.curve.points.set(force, point.both === null && before && !before.rough ? before : point);
    });
    known.curve.rough = m.rough;
    if (!m.rough && m.complete) {
      known.old = null;
      if (m.members === values.members) document.documentElement.dataset.whole = m.number; // for who waits for all members
    }
    note("curve", m.rough ? "rough" : m.complete ? `${m.members} member${m.members > 1 ? "s" : ""}` : "finer …");
    drawCurve();
  },
  line(m) { known.lines[m.which] = m; drawCurve(); },
  sweep(m) { known.sweep = m; drawSweep(); drawResponse(); },
  motion(m) { motion.show(m); note("motion", values.instant === null ? "around the maximum" : "around the chosen instant"); },
  response(m) { known.response = m; note("response", values.load === "random" ? "spectrum" : values.load !== "force" ? "" : m.note ? "no branches here" : m.complete ? `${m.branches.length} branch${m.branches.length === 1 ? "" : "es"}` : "following branches …"); drawResponse(); },
  card(m) { known.card = m; drawCard(); drawCurve(); },
  done(m) { performance.measure("all", { start: sent }); say(`all of it took ${((performance.now() - sent) / 1000).toFixed(1)} s`); document.documentElement.dataset.done = m.number; },
};
const VIEWS = new Set(["curve", "sweep", "motion", "response", "card", "line"]);

function received(m) {
  if (m.number !== undefined && m.number !== number && m.number !== -1) {
    // what an older setting still gives is drawn only where nothing newer is, and only while nothing newer is
    if (!VIEWS.has(m.type) || m.type !== "curve" || m.number < Math.max(shown.curve ?? 0, since.number)) return;
  }
  if (VIEWS.has(m.type)) {
    if (m.type === "line" && shown.curve !== m.number) return;
    take[m.type](m);
    shown[m.type] = m.number;
    if (m.number === number) panels[m.type === "line" ? "curve" : m.type].classList.remove("older");
    document.documentElement.dataset[`shown${m.type}`] = m.number;
    if (m.type === "curve" && m.number === number) {
      if (measured.first !== number) { measured.first = number; performance.measure("first points", { start: sent }); }
      if (measured.fine !== number && !m.rough && m.complete) { measured.fine = number; performance.measure("all forces", { start: sent }); }
    }
  } else take[m.type]?.(m);
}

function showErrors(errors) {
  for (const [name, { exact, error }] of rows) { error.textContent = errors[name] ?? ""; exact.setAttribute("aria-invalid", name in errors); }
  $("#wrong").textContent = Object.entries(errors).filter(([name]) => !rows.has(name)).map(([, text]) => text).join("; ");
  if (Object.keys(errors).length) for (const panel of Object.values(panels)) panel.classList.add("older");
}

const note = (panel, text) => { const place = panels[panel].querySelector(".note"); place.textContent = place.title = text; };

// figures

const load = () => controls.get(values.load), inWords = (intensity) => `${digits(intensity * load().per)} ${load().unit}`; // what acts, its intensity in SI units
const plots = { curve: new Plot(panels.curve, (x) => { set(values.load, Number((x / load().per).toPrecision(3))); changed(); }), sweep: new Plot(panels.sweep, chooseInstant), response: new Plot(panels.response, () => {}) };
const motion = new Motion(panels.motion);

function chooseInstant(ratio) {
  const s = known.sweep;
  if (!s) return;
  const first = s.ratio[0], last = s.ratio.at(-1), share = (ratio - first) / (last - first);
  values.instant = Number(Math.max(0, s.time[0] + share * (s.time.at(-1) - s.time[0])).toPrecision(6));
  changed(true);
}

function curveLine(points, name, which, more) {
  const sorted = [...points].sort((a, b) => a[0] - b[0]);
  return { name, x: sorted.map(([force]) => force), y: sorted.map(([, p]) => p[which]), ...more };
}

function drawCurve() {
  if (!known.curve) return;
  const which = values.direction, free = known.lines.none, slope = free ? free.level.at(-1) / free.force.at(-1) : null, relative = $("#relative").checked && slope;
  const shownAs = (force, level) => (level === null ? null : relative ? (100 * level) / (slope * force) : 1e3 * level);
  const { per, label, unit } = load(), levels = values.load === "random" ? "RMS" : "level";
  const scaled = (line) => ({ ...line, x: line.x.map((v) => v * per), y: line.y.map((v, k) => shownAs(line.x[k], v)) });
  const points = [...known.curve.points], fine = points.filter(([, p]) => !p.rough), rough = points.filter(([, p]) => p.rough), lines = [];
  for (const [name, m] of Object.entries(known.lines)) lines.push(scaled({ name: LINES[name], x: m.force, y: m.level, colour: name, width: 1.2, dash: name === "limit" ? [6, 4] : undefined, faint: true, beside: true }));
  if (known.old) lines.push(scaled(curveLine([...known.old.points], "before", which, { colour: "quiet", width: 1, faint: true })));
  if (rough.length) lines.push(scaled(curveLine(rough, "rough", which, { colour: "tip", width: 1, dash: [3, 4], points: true, hollow: true })));
  lines.push(scaled(curveLine(fine, table.concepts[values.concept], which, { colour: "tip", width: 2, points: true })));
  const sorted = fine.filter(([, p]) => p.low !== null).sort((a, b) => a[0] - b[0]), card = known.card && shown.card === number ? known.card : null;
  const areas = which === "both" && sorted.length > 1 && known.curve && sorted.some(([, p]) => p.members > 1) ? [{ name: table.concepts[values.concept], colour: "band", x: sorted.map(([f]) => f * per), low: sorted.map(([f, p]) => shownAs(f, p.low)), high: sorted.map(([f, p]) => shownAs(f, p.high)) }] : [];
  const mark = values[values.load], what = label.toLowerCase();
  plots.curve.draw({ title: `${levels} over ${what}, ${table.concepts[values.concept]}`, x: { label: `${what} in ${unit}`, short: `${what}, ${unit}`, log: true }, y: { label: relative ? `${levels} in % of no absorber` : `${levels} in mm`, log: true }, lines, areas,
    marks: Number.isFinite(mark) && mark > 0 ? [{ x: mark * per, y: card && which === "both" && card.force === mark ? shownAs(card.force, card.level) : null }] : [] });
}

function drawSweep() {
  const s = known.sweep, up = s.ratio[0] < s.ratio.at(-1), order = up ? (a) => a : (a) => [...a].reverse(), ratio = order(s.ratio);
  const toRatio = (t) => s.ratio[0] + ((t - s.time[0]) / (s.time.at(-1) - s.time[0])) * (s.ratio.at(-1) - s.ratio[0]), mm = (a) => order(a).map((v) => (v === null ? null : 1e3 * v));
  const ends = s.window.map(toRatio).sort((a, b) => a - b), low = mm(s.low), high = mm(s.high);
  note("sweep", `${digits(1e3 * s.level, 3)} mm, ${s.impacts} impacts`);
  plots.sweep.draw({ title: `${s.swept ? `Sweep ${up ? "up" : "down"}` : "Run"} at ${inWords(s.force)}`, x: { label: s.swept ? "load's frequency over the resonance's" : "time in s", short: "at" }, y: { label: "displacement in mm" },
    lines: [{ name: "largest", x: ratio, y: high, colour: "tip", width: 1 }, { name: "least", x: ratio, y: low, colour: "tip", width: 1 }], areas: [{ name: "displacement", x: ratio, low, high, colour: "tip", strength: 0.45 }],
    spans: [ends], levels: [1, -1].map((sign) => ({ y: sign * 1e3 * s.level, colour: "level" })), ticks: s.marks.map(toRatio), marks: values.instant === null ? [] : [{ x: toRatio(values.instant) }] });
}

function drawResponse() {
  const r = known.response;
  if (!r) return;
  const mm = (a) => a.map((v) => (v === null ? null : 1e3 * v)), lines = [{ name: "no absorber", x: r.ratio, y: mm(r.without), colour: "none", width: 1.2 }], branches = [];
  if (r.stuck) lines.push({ name: "absorber stuck", x: r.ratio, y: mm(r.stuck), colour: "friction", width: 1.2, dash: [6, 4] });
  if (r.with) lines.push({ name: table.concepts[values.concept], x: r.ratio, y: mm(r.with), colour: "tip", width: 2 });
  const s = known.sweep;
  if (r.run) lines.push({ name: "the run", x: r.run[0], y: mm(r.run[1]), colour: "absorber", width: 1.2 });
  else if (s?.swept && s.force === r.force) {
    const up = s.ratio[0] < s.ratio.at(-1), turn = (a) => (up ? a : [...a].reverse());
    lines.push({ name: `sweep ${up ? "up" : "down"}`, x: turn(s.ratio), y: turn(s.high.map((v, k) => (v === null ? null : 1e3 * Math.max(v, -s.low[k])))), colour: "absorber", width: 1 });
  }
  for (const b of r.branches) {
    let from = 0;
    for (let k = 1; k <= b.ratio.length; k++) if (k === b.ratio.length || b.stable[k] !== b.stable[from]) {
      const part = [from, Math.min(k + 1, b.ratio.length)];
      branches.push({ name: b.stable[from] ? "stable orbits" : "unstable orbits", x: b.ratio.slice(...part), y: mm(b.amplitude.slice(...part)), colour: b.stable[from] ? "level" : "limit", width: b.stable[from] ? 2.2 : 1.3, dash: b.stable[from] ? undefined : [4, 4] });
      from = k;
    }
  }
  if (branches.length) for (const [name, colour, dash] of [["stable orbits", "level"], ["unstable orbits", "limit", [4, 4]]]) if (branches.some((b) => b.name === name)) lines.push({ name, x: [r.ratio[0]], y: [null], colour, dash, width: 2 });
  plots.response.draw({ title: `${values.load === "random" ? "Spectrum" : "Frequency response"} at ${inWords(r.force)}`, x: { label: "frequency over the resonance's", short: "at" }, y: { label: values.load === "random" ? "density in mm/√Hz" : "amplitude in mm", from: 0 }, lines, branches, broken: true });
}

const mm = (x, n = 4) => (x === null ? "–" : `${digits(1e3 * x, n)} mm`);
function cardRows(c) {
  const all = [[values.load === "random" ? "RMS" : "Level", mm(c.level)], ["90 % of further runs", c.band[0] === null ? "–" : `${digits(1e3 * c.band[0])} to ${mm(c.band[1])}`], ["Without absorber", mm(c.without)], ["Of no absorber", `${digits((100 * c.level) / c.without, 3)} %`]];
  if (c.limit !== undefined) all.push(["Limit, mass and gap", c.limit > 0 ? mm(c.limit) : "none at this force"], ["Share of the possible", c.share === null ? "–" : `${digits(100 * c.share, 3)} %`]);
  if (c.gap !== undefined) all.push(["Gap", mm(c.gap)], [values.load === "random" ? "Search begins at" : "Rule's gap here", mm(c.rule_gap)]);
  if (c.reach !== undefined) all.push(["Free amplitude / gap", digits(c.reach, 3)]);
  if (c.mass !== null) all.push(["Absorber's mass", `${digits(c.mass, 3)} kg`], ["Impacts a period", digits(c.impacts_a_period, 3)]);
  if (c.largest_speed !== undefined) all.push(["Impact speed, largest", `${digits(c.largest_speed, 3)} m/s`], ["Impact speed, RMS", `${digits(c.rms_speed, 3)} m/s`], ["Impacts a second", digits(c.impacts_a_second, 3)], ["Power lost in them", `${digits(1e3 * c.power, 3)} mW`]);
  if (c.acceleration !== null) all.push(["Acceleration, harmonic", `${digits(c.acceleration, 3)} m/s²`]);
  all.push(["Resonance", `${digits(c.resonance_hz)} Hz`]);
  if (c.rate !== null) all.push(["Sweep rate", `${digits(c.rate, 3)} % / 100 periods`], ["Sweeps start from", "the steady state"]);
  return all;
}
function drawCard() {
  const list = panels.card.querySelector("dl");
  list.replaceChildren(...cardRows(known.card).map(([term, text]) => { const pair = document.createElement("div"), dt = document.createElement("dt"), dd = document.createElement("dd"); dt.textContent = term; dd.textContent = text; pair.append(dt, dd); return pair; }));
  note("card", `${inWords(known.card.force)}, ${known.card.words}`);
}

function cardHtml() {
  const text = (t) => String(t).replace(/[&<>]/g, (ch) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;" })[ch]), c = known.card;
  const figures = Object.values(plots).filter((p) => p.figure).map((p) => svgOf(p.figure)).join("\n");
  return `<!doctype html><html lang="en"><meta charset="utf-8"><title>Design card</title><style>body{font:15px sans-serif;max-width:60rem;margin:2rem auto}td,th{padding:.2rem .8rem;text-align:left;border-bottom:1px solid #ccc}</style>
<h1>Design card</h1><p>${text(table.structure)}; ${text(c.words)}; ${text(table.loads[values.load])}, ${inWords(c.force)}, near resonance ${values.resonance}.</p><table>${cardRows(c).map(([a, b]) => `<tr><th>${text(a)}</th><td>${text(b)}</td></tr>`).join("")}</table>
<p>The same by hand, with what is below as scene.json${known.load ? " and load.json" : ""}:</p><pre>${text(known.command)}</pre>${[known.scene, known.load].filter(Boolean).map((file) => `<pre>${text(JSON.stringify(file, null, 1))}</pre>`).join("")}${figures}</html>`;
}

// saving, colours, start

for (const name of ["curve", "sweep", "response"]) {
  const choice = document.createElement("select");
  for (const kind of ["Save", "PNG", "SVG", "CSV"]) choice.append(new Option(kind, kind));
  choice.setAttribute("aria-label", `Save the ${name} as`);
  choice.addEventListener("change", () => {
    const figure = plots[name].figure, kind = choice.value;
    choice.value = "Save";
    if (!figure) return;
    if (kind === "PNG") savePng(`${name}.png`, figure);
    if (kind === "SVG") save(`${name}.svg`, svgOf(figure), "image/svg+xml");
    if (kind === "CSV") save(`${name}.csv`, csvOf(figure), "text/csv");
  });
  panels[name].querySelector(".saves").append(choice);
}
for (const button of document.querySelectorAll("[data-save]")) button.addEventListener("click", async () => {
  for (const file of ["scene", "load"]) if (button.dataset.save === file && known[file]) save(`${file}.json`, `${JSON.stringify(known[file], null, 1)}\n`, "application/json");
  if (button.dataset.save === "card" && known.card) save("design_card.html", cardHtml(), "text/html");
  if (button.dataset.save === "command") await navigator.clipboard.writeText(known.command).then(() => say("copied"), () => $("#command").focus());
});
const recolour = () => { for (const plot of Object.values(plots)) plot.recolour(); motion.draw(); };
$("#theme").addEventListener("change", (event) => { document.documentElement.dataset.theme = event.target.value; recolour(); });
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", recolour);
$("#relative").addEventListener("change", drawCurve);
$("#recommend").addEventListener("click", () => ask({ recommend: true }));
$("#defaults").addEventListener("click", () => { history.replaceState(null, "", location.pathname); fromAddress(); changed(); });
$("#controls").addEventListener("submit", (event) => event.preventDefault());
addEventListener("hashchange", () => { fromAddress(); changed(true); });

function connect() {
  socket = new WebSocket(`ws://${location.host}/socket`);
  socket.addEventListener("open", () => ask());
  socket.addEventListener("message", (event) => received(JSON.parse(event.data)));
  socket.addEventListener("close", (event) => { say(event.reason || "the server has ended; start it again"); if (!event.reason) setTimeout(connect, 2000); });
}
$("#structure").textContent = `on ${table.structure}`;
makeControls();
fromAddress();
showForConcept();
connect();
