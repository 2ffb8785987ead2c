// The figures of the page as plain data, from the server's messages.
import { formatNumber, formatQuantity } from "./format.js";

const LINE_NAMES = {
  none: "no absorber",
  limit: "limit",
  friction: "friction damper",
  tuned: "tuned absorber",
};
const END_NAMES = { none: "none", limit: "limit", friction: "damper", tuned: "tuned" };
const DASHES = { limit: [6, 4] };
const toMillimetres = (values) => values.map((v) => (v === null ? null : 1e3 * v));
const isRising = (values) => values[0] < values.at(-1);

function sortPoints(points) {
  return [...points].sort((a, b) => a[0] - b[0]);
}

// state: what the page knows; context: controls, table and the chosen values.
export function makeCurveFigure(state, context, relative) {
  const { values, table, loadControl } = context;
  const { per, label, unit } = loadControl;
  const none = state.lines.none;
  const slope = none ? none.level.at(-1) / none.force.at(-1) : null;
  const inPercent = relative && slope;
  const convert = (force, level) => {
    if (level === null) return null;
    return inPercent ? (100 * level) / (slope * force) : 1e3 * level;
  };
  const makeLine = (points, options) => {
    const sorted = sortPoints(points);
    return {
      x: sorted.map(([force]) => force * per),
      y: sorted.map(([force, point]) => convert(force, point[values.direction])),
      ...options,
    };
  };
  const own = table.concepts[values.concept];
  const lines = makeOwnLines(state, own, makeLine);
  for (const [which, line] of Object.entries(state.lines)) {
    lines.push({
      name: LINE_NAMES[which],
      end: END_NAMES[which],
      x: line.force.map((force) => force * per),
      y: line.level.map((level, k) => convert(line.force[k], level)),
      colour: which,
      width: 1.2,
      dash: DASHES[which],
      faint: true,
      beside: true,
    });
  }
  if (state.pinned && state.pinned.load === values.load) {
    const name = "pinned";
    const colour = "pinned";
    lines.splice(1, 0, makeLine(state.pinned.points, { name, end: name, colour, width: 1.6 }));
  }
  const what = label.toLowerCase();
  const levelName = values.load === "random" ? "RMS" : "level";
  return {
    title: `${levelName} over ${what}, ${own}`,
    x: { label: `${what} in ${unit}`, short: `${what}, ${unit}`, log: true },
    y: { label: inPercent ? `${levelName} in % of no absorber` : `${levelName} in mm`, log: true },
    lines,
    areas: makeBand(state, own, values.direction, per, convert),
    marks: makeLoadMark(state, context, convert),
  };
}

function makeOwnLines(state, name, makeLine) {
  const points = [...state.curve.points];
  const rough = points.filter(([, point]) => point.rough);
  const fine = points.filter(([, point]) => !point.rough);
  const lines = [makeLine(fine, { name, end: "absorber", colour: "tip", width: 2, points: true })];
  if (rough.length) {
    const style = { colour: "tip", width: 1, dash: [3, 4], points: true, hollow: true };
    lines.push(makeLine(rough, { name: "rough", ...style }));
  }
  if (state.previousCurve) {
    const style = { colour: "quiet", width: 1, faint: true };
    lines.push(makeLine(state.previousCurve.points, { name: "before", ...style }));
  }
  return lines;
}

function makeBand(state, name, direction, per, convert) {
  const points = sortPoints(state.curve.points).filter(([, p]) => !p.rough && p.low !== null);
  if (direction !== "both" || points.length < 2) return [];
  return [
    {
      name,
      legend: "90 % of further runs",
      colour: "band",
      x: points.map(([force]) => force * per),
      low: points.map(([force, point]) => convert(force, point.low)),
      high: points.map(([force, point]) => convert(force, point.high)),
    },
  ];
}

function makeLoadMark(state, { values, loadControl, isCurrentCard }, convert) {
  const force = values[values.load];
  if (!Number.isFinite(force) || force <= 0) return [];
  const card = isCurrentCard && state.card.force === force ? state.card : null;
  return [
    {
      x: force * loadControl.per,
      y: card ? convert(force, card.level) : null,
      name: formatQuantity(force, loadControl.unit, loadControl.per),
    },
  ];
}

export function ratioOfTime(sweep, time) {
  const first = sweep.time[0];
  const share = (time - first) / (sweep.time.at(-1) - first);
  return sweep.ratio[0] + share * (sweep.ratio.at(-1) - sweep.ratio[0]);
}

export function timeOfRatio(sweep, ratio) {
  const share = (ratio - sweep.ratio[0]) / (sweep.ratio.at(-1) - sweep.ratio[0]);
  const time = sweep.time[0] + share * (sweep.time.at(-1) - sweep.time[0]);
  return Math.max(0, time);
}

export function makeSweepFigure(sweep, { values, loadControl }) {
  const rising = isRising(sweep.ratio);
  const order = (list) => (rising ? list : [...list].reverse());
  const ratio = order(sweep.ratio);
  const low = order(toMillimetres(sweep.low));
  const high = order(toMillimetres(sweep.high));
  const direction = rising ? "up" : "down";
  const load = formatQuantity(sweep.force, loadControl.unit, loadControl.per);
  const level = { colour: "level" };
  return {
    title: `${sweep.swept ? `Sweep ${direction}` : "Run"} at ${load}`,
    x: { label: sweep.swept ? "load's frequency over the resonance's" : "time in s", short: "at" },
    y: { label: "displacement in mm" },
    lines: [
      { name: "largest", x: ratio, y: high, colour: "tip", width: 1 },
      { name: "least", x: ratio, y: low, colour: "tip", width: 1 },
    ],
    areas: [{ name: "displacement", x: ratio, low, high, colour: "tip", strength: 0.45 }],
    spans: [sweep.window.map((t) => ratioOfTime(sweep, t)).sort((a, b) => a - b)],
    levels: [1, -1].map((sign) => ({ y: sign * 1e3 * sweep.level, ...level })),
    ticks: sweep.marks.map((t) => ratioOfTime(sweep, t)),
    marks: values.instant === null ? [] : [{ x: ratioOfTime(sweep, values.instant) }],
  };
}

// isCurrentSweep: whether the run is of the same setting as the response.
export function makeResponseFigure(response, sweep, context, isCurrentSweep) {
  const { values, table, loadControl } = context;
  const load = formatQuantity(response.force, loadControl.unit, loadControl.per);
  const own = table.concepts[values.concept];
  if (response.levels?.ratio) return makeLevelsFigure(response.levels, own, load);
  const lines = [];
  const add = (name, ys, style) => {
    if (ys) lines.push({ name, x: response.ratio, y: toMillimetres(ys), width: 1.2, ...style });
  };
  add(own, response.with, { colour: "tip", width: 2 });
  add("no absorber", response.without, { colour: "none" });
  add("absorber stuck", response.stuck, { colour: "friction", dash: [6, 4] });
  if (response.run) {
    const [x, y] = response.run;
    lines.push({ name: "the run", x, y: toMillimetres(y), colour: "absorber", width: 1.2 });
  } else if (isCurrentSweep && sweep.swept) {
    lines.push(makePeakLine(sweep));
  }
  const branches = response.branches.flatMap(splitBranch);
  for (const [name, style] of Object.entries(BRANCH_STYLES)) {
    // a line without points, for the legend
    if (!branches.some((branch) => branch.name === name)) continue;
    lines.push({ name, x: [response.ratio[0]], y: [null], ...style });
  }
  const random = values.load === "random";
  return {
    title: `${random ? "Spectrum" : "Frequency response"} at ${load}`,
    x: { label: "frequency over the resonance's", short: "at" },
    y: { label: random ? "density in mm/√Hz" : "amplitude in mm", from: 0 },
    lines,
    branches,
    broken: true,
  };
}

function makeLevelsFigure(levels, own, load) {
  const lines = [];
  const add = (name, end, ys, colour, width) => {
    if (ys) lines.push({ name, end, x: levels.ratio, y: toMillimetres(ys), colour, width });
  };
  add(own, "absorber", levels.with, "tip", 2);
  add("no absorber", "none", levels.without, "none", 1.2);
  return {
    title: `Level over the frequency at ${load}`,
    x: { label: "load's frequency over the resonance's", short: "at" },
    y: { label: "level in mm", from: 0 },
    lines,
  };
}

function makePeakLine(sweep) {
  const rising = isRising(sweep.ratio);
  const order = (list) => (rising ? list : [...list].reverse());
  const peaks = sweep.high.map((v, k) => (v === null ? null : 1e3 * Math.max(v, -sweep.low[k])));
  return {
    name: `sweep ${rising ? "up" : "down"}`,
    x: order(sweep.ratio),
    y: order(peaks),
    colour: "absorber",
    width: 1,
  };
}

const BRANCH_STYLES = {
  "stable motions": { colour: "level", width: 2.2 },
  "unstable motions": { colour: "limit", width: 1.3, dash: [4, 4] },
};

// Return the parts of a branch of equal stability, each with its neighbour's first point so that they touch.
function splitBranch(branch) {
  const parts = [];
  let from = 0;
  for (let k = 1; k <= branch.ratio.length; k++) {
    if (k < branch.ratio.length && branch.stable[k] === branch.stable[from]) continue;
    const name = branch.stable[from] ? "stable motions" : "unstable motions";
    const end = Math.min(k + 1, branch.ratio.length);
    parts.push({
      name,
      x: branch.ratio.slice(from, end),
      y: toMillimetres(branch.amplitude.slice(from, end)),
      ...BRANCH_STYLES[name],
    });
    from = k;
  }
  return parts;
}

export function describeSweep(sweep) {
  const where = sweep.where ? `${sweep.where}: ` : "";
  return `${where}${formatNumber(1e3 * sweep.level, 3)} mm, ${sweep.impacts} impacts`;
}
