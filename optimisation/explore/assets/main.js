// The page: sends the newest setting to the server, and shows what comes back, never something older over something newer.
import { SettingHistory, readSetting } from "./address.js";
import {
  describeSweep,
  makeCurveFigure,
  makeResponseFigure,
  makeSweepFigure,
  ratioOfTime,
  timeOfRatio,
} from "./charts.js";
import { ControlTable } from "./controls.js";
import { Plot, csvOf, save, savePng, svgOf } from "./figure.js";
import { formatQuantity } from "./format.js";
import { Motion } from "./motion.js";
import {
  describeChanges,
  makeCardPage,
  showComparison,
  showNumbers,
  showVerdict,
} from "./verdict.js";

const find = (selector) => document.querySelector(selector);
const PANELS = ["curve", "sweep", "response", "motion", "card"];
const FIGURES = ["curve", "sweep", "response"];
const DRAWN = new Set([...PANELS, "line", "whole_run"]);
const PANEL_OF = { line: "curve", whole_run: "motion" };
const COMPILED = {
  none: "curve without absorber",
  friction: "friction damper's curve",
  tuned: "tuned absorber's curve",
};
const RECONNECT = 2000; // ms

const panels = Object.fromEntries(PANELS.map((name) => [name, find(`#${name}`)]));
const marks = document.documentElement.dataset; // numbers of the settings that are drawn, for tests and measurements
const tables = new Map();
let socket = null;
let isScheduled = false;

// What is drawn. Each part has the number of its setting in `drawn`.
const state = {
  number: 0,
  sent: 0,
  drawn: {},
  firstOfUnit: 0, // number of the first setting in the load's unit
  load: null,
  curve: null,
  previousCurve: null,
  lines: {},
  sweep: null,
  response: null,
  card: null,
  pinned: null,
  files: {},
  commands: [],
  measured: {},
};

// Structures and their controls.

async function loadTable(key) {
  if (!tables.has(key)) {
    const query = key ? `?structure=${encodeURIComponent(key)}` : "";
    const answer = await fetch(`controls${query}`);
    if (!answer.ok) return null;
    const table = await answer.json();
    tables.set(key, table).set(table.key, table);
  }
  return tables.get(key);
}

async function useStructure(key) {
  const table = (await loadTable(key)) ?? (await loadTable(""));
  if (table === controls.table) return;
  controls.useTable(table);
  find("#structure").textContent = `on ${table.structure}`;
  forgetUnit();
}

const ownTable = await loadTable("");
const controls = new ControlTable(find("#groups"), ownTable, (name) => changeSetting(name));
const values = () => controls.values;

function describeContext() {
  return {
    values: values(),
    table: controls.table,
    loadControl: controls.controls.get(values().load),
    isCurrentCard: state.drawn.card === state.number,
  };
}

function formatLoad(intensity) {
  const control = controls.controls.get(values().load);
  return formatQuantity(intensity, control.unit, control.per);
}

// Settings: from the address, into it, and to the server.

function describeSetting() {
  const words = new URLSearchParams();
  if (controls.table.key !== ownTable.key) words.set("structure", controls.table.key);
  for (const [name, value] of controls.listChanges()) words.set(name, value);
  return words;
}

async function restoreSetting(words) {
  await useStructure(words.structure ?? ownTable.key);
  const wrong = [];
  const setting = {};
  for (const [name, text] of Object.entries(words)) {
    const isNumber = controls.controls.has(name) || name === "instant";
    if (isNumber && (text === "" || !Number.isFinite(Number(text)))) wrong.push(`${name}=${text}`);
    else setting[name] = isNumber ? Number(text) : text;
  }
  controls.setAll(setting);
  find("#view").value = values().view;
  updateButtons();
  sendSetting();
  if (wrong.length)
    showProblem(`The address has ${wrong.join(", ")}, which is no number: the default is used.`);
}

const steps = new SettingHistory(restoreSetting, (canUndo, canRedo) => {
  find("#undo").disabled = !canUndo;
  find("#redo").disabled = !canRedo;
});

function changeSetting(source, { keepInstant = false } = {}) {
  if (!keepInstant) values().instant = null;
  find("#why").textContent = "";
  updateButtons();
  steps.record(describeSetting(), source);
  if (isScheduled) return;
  isScheduled = true;
  requestAnimationFrame(() => {
    isScheduled = false;
    sendSetting();
  });
}

function updateButtons() {
  const { concept, load } = values();
  find("#recommend").disabled =
    concept === "none" || (concept === "friction" && load === "random") || !controls.table.advice;
}

function sendSetting(extra = {}) {
  if (socket?.readyState !== WebSocket.OPEN) return;
  if (controls.hasErrors()) {
    markOlder();
    showProblem("Not computed: a value is no number.");
    setStatus("");
    return;
  }
  state.number += 1;
  if (values().load !== state.load) {
    state.load = values().load;
    forgetUnit();
  }
  state.sent = performance.now();
  if (!extra.recommend) markOlder();
  showProblem("");
  setStatus(extra.recommend ? "searching" : "computing");
  const { key } = controls.table;
  const message = { number: state.number, structure: key, values: values(), ...extra };
  socket.send(JSON.stringify(message));
  marks.asked = state.number;
}

// Curves of another unit or structure cannot be compared with.
function forgetUnit() {
  state.firstOfUnit = state.number;
  state.curve = state.previousCurve = null;
  state.lines = {};
}

function markOlder() {
  for (const panel of Object.values(panels)) panel.classList.add("older");
  find("#verdict").classList.add("older");
}

function setStatus(text) {
  find("#status").textContent = text;
}

function showProblem(text) {
  const place = find("#problem");
  place.textContent = text;
  place.hidden = text === "";
}

function setNote(panel, text) {
  const place = panels[panel].querySelector(".note");
  place.textContent = text;
  place.title = text;
}

// Messages of the server.

const handlers = {
  taken(message) {
    state.files = { "scene.json": message.scene, ...message.loads };
    state.commands = message.commands;
    find("[data-save=load]").hidden = !Object.keys(message.loads).length;
    find("#command").textContent = message.commands.join("\n");
    const both = message.commands.length > 1;
    find("#command-note").textContent = both
      ? "The level is the median over the members of the larger one of both sweeps."
      : "";
    controls.showErrors({});
    find("#wrong").textContent = "";
  },

  refused(message) {
    const others = controls.showErrors(message.errors);
    find("#wrong").textContent = others.join("; ");
    markOlder();
    showProblem(`Not computed. ${Object.values(message.errors).join("; ")}`);
    setStatus("");
  },

  failed(message) {
    showProblem(`This could not be computed: ${message.error}`);
    setStatus("");
    hideProgress();
  },

  problem(message) {
    const panel = message.what;
    setNote(panel, `not computed: ${message.error}`);
    if (panel === "card") showVerdictProblem(message.error);
  },

  compiling(message) {
    const panel = PANELS.includes(message.what) ? message.what : "curve";
    const isDone = message.seconds === null;
    const text = isDone ? "" : `compiling, ${message.seconds.toFixed(0)} s`;
    setNote(panel, text);
    const plot = panels[panel].querySelector(".plot");
    if (plot) plot.dataset.waits = text && `${text}: once for each kind of absorber`;
    const what = COMPILED[message.what] ?? message.what;
    setStatus(isDone ? "computing" : `compiling for the ${what}: once, up to a minute`);
  },

  advice(message) {
    if (message.values === undefined) {
      find("#progress").hidden = false;
      find("#progress").value = message.done / message.total;
      return;
    }
    hideProgress();
    const before = { ...values() };
    for (const [name, value] of Object.entries(message.values)) {
      controls.set(name, Number(value.toPrecision(4)));
    }
    const changes = describeChanges(controls.controls, before, values());
    changeSetting("recommend");
    find("#why").textContent = `${changes || "No change"}: ${message.why}.`;
  },

  curve(message) {
    addCurvePoints(message);
    const whole = message.complete
      ? `${message.members} member${message.members > 1 ? "s" : ""}`
      : "finer …";
    setNote("curve", message.rough ? "rough" : whole);
    drawCurve();
  },

  line(message) {
    state.lines[message.which] = message;
    drawCurve();
  },

  sweep(message) {
    state.sweep = message;
    setNote("sweep", describeSweep(message));
    plots.sweep.draw(makeSweepFigure(message, describeContext()));
  },

  motion(message) {
    motion.show("part", message);
    setNote(
      "motion",
      values().instant === null ? "around the maximum" : "around the chosen instant",
    );
  },

  whole_run(message) {
    motion.show("whole", message);
  },

  response(message) {
    // the levels over the frequency come at the end: until then those of the setting before stay
    const waits = !message.complete && message.swept && values().view === "levels";
    if (waits && state.response?.levels) return;
    state.response = message;
    setNote("response", describeResponse(message));
    drawResponse();
  },

  card(message) {
    state.card = message;
    showVerdict(message);
    find("#verdict").classList.remove("older");
    find("#pin").disabled = false;
    showNumbers(controls.table.numbers, message, `${formatLoad(message.force)}, ${message.words}`);
    updateComparison();
    drawCurve();
  },

  done(message) {
    performance.measure("all", { start: state.sent });
    setStatus(`computed in ${((performance.now() - state.sent) / 1000).toFixed(1)} s`);
    marks.done = message.number;
  },
};

function handleMessage(message) {
  const { type, number } = message;
  const isOlder = number !== undefined && number !== state.number && number !== -1;
  if (isOlder) {
    // an older curve is drawn while there is nothing newer
    const newest = Math.max(state.drawn.curve ?? 0, state.firstOfUnit);
    if (type !== "curve" || number < newest) return;
  }
  if (!DRAWN.has(type)) {
    handlers[type]?.(message);
    return;
  }
  if (type === "line" && state.drawn.curve !== number) return;
  state.drawn[type === "curve" ? "nextCurve" : type] = number;
  handlers[type](message);
  const panel = PANEL_OF[type] ?? type;
  if (number === state.number) panels[panel].classList.remove("older");
  marks[`shown${type}`] = number;
  if (type === "curve" && number === state.number) measureCurve(message);
}

function addCurvePoints(message) {
  if (state.drawn.curve !== message.number) {
    state.previousCurve = state.curve;
    state.curve = { points: new Map() };
    state.lines = {};
  }
  state.drawn.curve = message.number;
  message.force.forEach((force, k) => {
    const before = state.curve.points.get(force);
    const point = { rough: message.rough, members: message.members };
    for (const name of ["both", "low", "high", "up", "down"]) point[name] = message[name][k];
    if (point.both === null && point.up === null && point.down === null) return;
    if (before && !before.rough && message.rough) return;
    const keepsBefore = point.both === null && before && !before.rough;
    state.curve.points.set(force, keepsBefore ? before : point);
  });
  if (!message.rough && message.complete) {
    state.previousCurve = null;
    if (message.members === values().members) marks.whole = message.number;
  }
}

function measureCurve(message) {
  if (state.measured.first !== state.number) {
    state.measured.first = state.number;
    performance.measure("first points", { start: state.sent });
  }
  if (state.measured.fine !== state.number && !message.rough && message.complete) {
    state.measured.fine = state.number;
    performance.measure("all forces", { start: state.sent });
  }
}

function showVerdictProblem(error) {
  find("#verdict").dataset.grade = "neutral";
  find("#headline").textContent = "no verdict";
  find("#band").textContent = "";
  find("#sentence").textContent = error;
}

function hideProgress() {
  find("#progress").hidden = true;
}

function describeResponse(message) {
  if (values().load === "random") return "spectrum";
  if (message.note) return "no motions of this kind here";
  if (values().view === "levels" || values().load !== "force")
    return message.complete ? "" : "computing …";
  const count = message.branches.length;
  if (!message.complete) return "following branches …";
  return `${count} branch${count === 1 ? "" : "es"}`;
}

// Figures.

const plots = {
  curve: new Plot(panels.curve, (x) => {
    const control = controls.controls.get(values().load);
    controls.set(control.name, Number((x / control.per).toPrecision(3)));
    changeSetting("curve");
  }),
  sweep: new Plot(panels.sweep, (x) => {
    if (!state.sweep) return;
    values().instant = Number(timeOfRatio(state.sweep, x).toPrecision(6));
    find("#extent").value = "part";
    changeSetting("instant", { keepInstant: true });
  }),
  response: new Plot(panels.response),
};
const motion = new Motion(panels.motion, (time) => {
  plots.sweep.setCursor(time === null || !state.sweep ? null : ratioOfTime(state.sweep, time));
});

function drawCurve() {
  if (!state.curve) return;
  plots.curve.draw(makeCurveFigure(state, describeContext(), find("#relative").checked));
}

function drawResponse() {
  if (!state.response) return;
  const isCurrent = state.drawn.sweep === state.drawn.response;
  plots.response.draw(
    makeResponseFigure(state.response, state.sweep, describeContext(), isCurrent),
  );
}

// A pinned curve, to compare with.

function pinCurve() {
  const fine = [...state.curve.points].filter(([, point]) => !point.rough);
  const { words, force } = state.card;
  state.pinned = {
    points: fine,
    load: values().load,
    values: { ...values() },
    setting: describeSetting(),
    card: state.card,
    name: `${words} at ${formatLoad(force)}`,
  };
  updatePins();
}

function unpinCurve() {
  state.pinned = null;
  updatePins();
}

function updatePins() {
  find("#unpin").hidden = find("#restore").hidden = !state.pinned;
  updateComparison();
  drawCurve();
}

function updateComparison() {
  const card = state.drawn.card === state.number ? state.card : null;
  showComparison(state.pinned, card, controls.controls, values());
}

async function restoreWords(words, source) {
  await restoreSetting(Object.fromEntries(words));
  steps.record(describeSetting(), source);
}

// Saving.

function addSaveList(name) {
  const list = document.createElement("select");
  for (const kind of ["Save", "PNG", "SVG", "CSV"]) list.append(new Option(kind, kind));
  list.setAttribute("aria-label", `Save the ${name} as`);
  list.addEventListener("change", () => {
    const kind = list.value;
    list.value = "Save";
    saveFigure(name, kind);
  });
  panels[name].querySelector(".saves").append(list);
}

function saveFigure(name, kind) {
  const { figure } = plots[name];
  if (!figure) return;
  if (kind === "PNG") savePng(`${name}.png`, figure);
  if (kind === "SVG") save(`${name}.svg`, svgOf(figure), "image/svg+xml");
  if (kind === "CSV") save(`${name}.csv`, csvOf(figure), "text/csv");
}

function saveFile(name) {
  const content = `${JSON.stringify(state.files[name], null, 1)}\n`;
  if (state.files[name]) save(name, content, "application/json");
}

function saveCard() {
  if (!state.card) return;
  const { load, resonance } = values();
  const near = resonance === undefined ? "" : `, near resonance ${resonance}`;
  const page = makeCardPage({
    title: `${controls.table.structure}; ${state.card.words}`,
    about: `${controls.table.loads[load]}, ${formatLoad(state.card.force)}${near}`,
    card: state.card,
    rows: controls.table.numbers,
    commands: state.commands.join("\n"),
    files: state.files,
    figures: Object.values(plots)
      .filter((plot) => plot.figure)
      .map((plot) => svgOf(plot.figure)),
  });
  save("design_card.html", page, "text/html");
}

async function copyText(text, fallback) {
  try {
    await navigator.clipboard.writeText(text);
    setStatus("copied");
  } catch {
    fallback();
  }
}

const savers = {
  scene: () => saveFile("scene.json"),
  load: () =>
    Object.keys(state.files)
      .filter((name) => name !== "scene.json")
      .forEach(saveFile),
  card: saveCard,
  command: () => copyText(state.commands.join("\n"), () => find("#command").focus()),
};

// Start.

function addExamples() {
  const place = find("#examples");
  place.append("Examples: ");
  for (const example of ownTable.examples) {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = example.title;
    button.title = example.about;
    button.addEventListener("click", () => {
      restoreWords(Object.entries({ structure: example.structure, ...example.values }), "example");
    });
    place.append(button);
  }
}

function addViews() {
  const list = find("#view");
  for (const [name, label] of Object.entries(ownTable.views)) list.append(new Option(label, name));
  list.addEventListener("change", () => {
    values().view = list.value;
    changeSetting("view", { keepInstant: true });
  });
}

function toggleDrawer() {
  const isOpen = document.body.classList.toggle("drawer-open");
  find("#drawer").setAttribute("aria-expanded", isOpen);
  find("#drawer").textContent = isOpen ? "Close the controls" : "Controls";
}

function recolour() {
  for (const plot of Object.values(plots)) plot.recolour();
  motion.draw();
}

function addListeners() {
  const onClick = (selector, action) => find(selector).addEventListener("click", action);
  for (const button of document.querySelectorAll("[data-save]")) {
    button.addEventListener("click", () => savers[button.dataset.save]());
  }
  find("#theme").addEventListener("change", (event) => {
    document.documentElement.dataset.theme = event.target.value;
    recolour();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", recolour);
  find("#relative").addEventListener("change", drawCurve);
  onClick("#recommend", () => sendSetting({ recommend: true }));
  onClick("#defaults", () => restoreWords([["structure", controls.table.key]], "defaults"));
  onClick("#undo", () => history.back());
  onClick("#redo", () => history.forward());
  onClick("#link", () =>
    copyText(location.href, () => prompt("The page's address", location.href)),
  );
  onClick("#pin", pinCurve);
  onClick("#unpin", unpinCurve);
  onClick("#restore", () => restoreWords(state.pinned.setting, "pinned"));
  onClick("#drawer", toggleDrawer);
  find("#controls").addEventListener("submit", (event) => event.preventDefault());
  addEventListener("keydown", (event) => {
    if (event.key === "Escape" && document.body.classList.contains("drawer-open")) toggleDrawer();
  });
}

function connect() {
  socket = new WebSocket(`ws://${location.host}/socket`);
  socket.addEventListener("open", () => restoreSetting(readSetting()));
  socket.addEventListener("message", (event) => handleMessage(JSON.parse(event.data)));
  socket.addEventListener("close", (event) => {
    setStatus("");
    showProblem(event.reason || "The explorer has ended. Start it again, and this page goes on.");
    if (!event.reason) setTimeout(connect, RECONNECT);
  });
}

find("#structure").textContent = `on ${ownTable.structure}`;
FIGURES.forEach(addSaveList);
addExamples();
addViews();
addListeners();
connect();
