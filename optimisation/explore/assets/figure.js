// A figure is plain data: lines, areas, branches and marks. uPlot draws it on a page; the same data are written as SVG, PNG or CSV.
// This file is also part of the cards that commands write, so it imports nothing.

const readStyle = (name) =>
  getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

const FONT = "11px system-ui, sans-serif";
const LABEL_HEIGHT = 13; // px between the labels at the ends of lines
const LABEL_GAP = 6;
const NARROW = 340; // px: narrower figures have no labels at the ends
const LOG_MARGIN = [1.15, 1.25];
const LINEAR_MARGIN = 0.06;

function formatDigits(value, digits = 4) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  return String(Number(value.toPrecision(digits)));
}

function collectValues(figure, axis) {
  const lines = [...figure.lines, ...(figure.branches ?? [])];
  const main = lines.filter((line) => !line.beside && line[axis].length);
  const values = [];
  // a line beside the main ones is cut off where it leaves their range
  for (const line of main.length ? main : lines) values.push(...line[axis]);
  for (const area of figure.areas ?? []) {
    values.push(...(axis === "x" ? area.x : [...area.low, ...area.high]));
  }
  for (const mark of figure.marks ?? []) if (Number.isFinite(mark[axis])) values.push(mark[axis]);
  return values;
}

function findRange(figure, axis) {
  const { log, from } = figure[axis];
  const isUsable = log ? (v) => Number.isFinite(v) && v > 0 : Number.isFinite;
  let low = Infinity;
  let high = -Infinity;
  for (const value of collectValues(figure, axis)) {
    if (value === null || !isUsable(value)) continue;
    low = Math.min(low, value);
    high = Math.max(high, value);
  }
  if (low > high) return log ? [0.1, 10] : [0, 1];
  if (axis === "x") return low < high ? [low, high] : [low - 1, high + 1];
  if (log) return [low / LOG_MARGIN[0], high * LOG_MARGIN[1]];
  const margin = LINEAR_MARGIN * (high - low || Math.abs(high) || 1);
  return [from === undefined ? low - margin : from, high + margin];
}

function listTicks(low, high, log) {
  if (log && high > 3 * low) {
    const wide = high > 1e3 * low;
    const multiples = wide ? [1] : high > 8 * low ? [1, 2, 5] : [1, 1.5, 2, 3, 4, 5, 7];
    const ticks = [];
    for (let decade = Math.floor(Math.log10(low)); decade <= Math.log10(high); decade++) {
      ticks.push(...multiples.map((multiple) => multiple * 10 ** decade));
    }
    return ticks.filter((tick) => tick >= low && tick <= high);
  }
  const raw = (high - low) / 6;
  const unit = 10 ** Math.floor(Math.log10(raw));
  const step = unit * [1, 2, 5, 10].find((multiple) => multiple * unit >= raw);
  const ticks = [];
  for (let v = Math.ceil(low / step) * step; v <= high + 1e-9 * step; v += step) {
    ticks.push(Number(v.toPrecision(12)));
  }
  return ticks;
}

function findNearest(xs, x, ys) {
  let best = -1;
  for (let k = 0; k < xs.length; k++) {
    if (xs[k] === null || ys[k] === null) continue;
    if (best < 0 || Math.abs(xs[k] - x) < Math.abs(xs[best] - x)) best = k;
  }
  return best;
}

// Return the labels at the ends of lines with their heights in px, moved apart so that none covers another.
function placeEndLabels(figure, yOf, top, bottom, xLimits) {
  const labels = [];
  for (const line of figure.lines) {
    if (!line.end) continue;
    let last = line.x.length - 1;
    while (last >= 0 && (line.y[last] === null || line.x[last] > xLimits[1])) last--;
    if (last < 0) continue;
    const y = yOf(line.y[last]);
    if (!Number.isFinite(y)) continue;
    labels.push({ text: line.end, colour: line.colour, y: Math.min(Math.max(y, top), bottom) });
  }
  labels.sort((a, b) => a.y - b.y);
  for (let k = 1; k < labels.length; k++) {
    labels[k].y = Math.max(labels[k].y, labels[k - 1].y + LABEL_HEIGHT);
  }
  for (let k = labels.length - 1; k >= 0; k--) {
    const limit = k === labels.length - 1 ? bottom : labels[k + 1].y - LABEL_HEIGHT;
    labels[k].y = Math.min(labels[k].y, limit);
  }
  return labels;
}

function traceLine(context, plot, xs, ys) {
  context.beginPath();
  let drawing = false;
  xs.forEach((x, k) => {
    if (ys[k] === null || x === null) {
      drawing = false;
      return;
    }
    const at = [plot.valToPos(x, "x", true), plot.valToPos(ys[k], "y", true)];
    if (drawing) context.lineTo(...at);
    else context.moveTo(...at);
    drawing = true;
  });
}

function clipToPlot(context, plot) {
  const { left, top, width, height } = plot.bbox;
  context.beginPath();
  context.rect(left, top, width, height);
  context.clip();
}

function drawBelow(plot, figure) {
  const context = plot.ctx;
  const { left, top, width, height } = plot.bbox;
  const xOf = (v) => plot.valToPos(v, "x", true);
  const yOf = (v) => plot.valToPos(v, "y", true);
  context.save();
  clipToPlot(context, plot);
  for (const [from, to] of figure.spans ?? []) {
    context.fillStyle = readStyle("level");
    context.globalAlpha = 0.16;
    context.fillRect(xOf(from), top, xOf(to) - xOf(from), height);
  }
  for (const area of figure.areas ?? []) {
    const known = area.x
      .map((_, k) => k)
      .filter((k) => area.low[k] !== null && area.high[k] !== null);
    context.fillStyle = readStyle(area.colour);
    context.globalAlpha = area.strength ?? 1;
    context.beginPath();
    for (const k of known) context.lineTo(xOf(area.x[k]), yOf(area.high[k]));
    for (const k of known.reverse()) context.lineTo(xOf(area.x[k]), yOf(area.low[k]));
    context.fill();
  }
  context.globalAlpha = 1;
  context.setLineDash([6, 4]);
  context.lineWidth = 1.2;
  for (const line of figure.levels ?? []) {
    context.strokeStyle = readStyle(line.colour);
    context.beginPath();
    context.moveTo(left, yOf(line.y));
    context.lineTo(left + width, yOf(line.y));
    context.stroke();
  }
  context.restore();
}

function drawBranches(plot, figure, ratio) {
  const context = plot.ctx;
  for (const line of figure.branches ?? []) {
    context.strokeStyle = readStyle(line.colour);
    context.lineWidth = line.width * ratio;
    context.setLineDash((line.dash ?? []).map((length) => length * ratio));
    traceLine(context, plot, line.x, line.y);
    context.stroke();
  }
  context.setLineDash([]);
}

function drawImpacts(plot, figure, ratio) {
  if (!figure.ticks?.length) return;
  const context = plot.ctx;
  const bottom = plot.bbox.top + plot.bbox.height;
  context.strokeStyle = readStyle("absorber");
  context.globalAlpha = Math.min(1, Math.max(0.12, 300 / figure.ticks.length));
  context.lineWidth = ratio;
  context.beginPath();
  for (const tick of figure.ticks) {
    const x = plot.valToPos(tick, "x", true);
    context.moveTo(x, bottom);
    context.lineTo(x, bottom - 10 * ratio);
  }
  context.stroke();
  context.globalAlpha = 1;
}

function drawMark(plot, mark, row, ratio) {
  const context = plot.ctx;
  const { left, top, width, height } = plot.bbox;
  const x = plot.valToPos(mark.x, "x", true);
  context.strokeStyle = readStyle("text");
  context.fillStyle = readStyle("text");
  context.lineWidth = ratio;
  context.setLineDash([2 * ratio, 3 * ratio]);
  context.beginPath();
  context.moveTo(x, top);
  context.lineTo(x, top + height);
  context.stroke();
  context.setLineDash([]);
  if (mark.name) {
    context.font = `${11 * ratio}px system-ui, sans-serif`;
    const right = x + 4 * ratio + context.measureText(mark.name).width > left + width;
    context.textAlign = right ? "right" : "left";
    context.fillText(mark.name, x + (right ? -4 : 4) * ratio, top + (11 + 14 * row) * ratio);
  }
  if (mark.y) {
    context.beginPath();
    context.arc(x, plot.valToPos(mark.y, "y", true), 4 * ratio, 0, 7);
    context.fill();
  }
}

function drawEndLabels(plot, figure, ratio) {
  const context = plot.ctx;
  const { left, top, width, height } = plot.bbox;
  const yOf = (v) => plot.valToPos(v, "y", true) / ratio;
  const limits = findRange(figure, "x");
  const labels = placeEndLabels(figure, yOf, top / ratio + 4, (top + height) / ratio - 4, limits);
  context.font = `${11 * ratio}px system-ui, sans-serif`;
  context.textAlign = "left";
  context.textBaseline = "middle";
  for (const label of labels) {
    context.fillStyle = readStyle(label.colour);
    context.fillText(label.text, left + width + LABEL_GAP * ratio, label.y * ratio);
  }
  context.textBaseline = "alphabetic";
}

function drawAbove(plot, figure, withLabels) {
  const ratio = devicePixelRatio;
  const context = plot.ctx;
  context.save();
  clipToPlot(context, plot);
  drawBranches(plot, figure, ratio);
  drawImpacts(plot, figure, ratio);
  (figure.marks ?? []).forEach((mark, row) => drawMark(plot, mark, row, ratio));
  context.restore();
  if (withLabels) drawEndLabels(plot, figure, ratio);
}

function measureEndLabels(figure) {
  const context = document.createElement("canvas").getContext("2d");
  context.font = FONT;
  const widths = figure.lines.map((line) => (line.end ? context.measureText(line.end).width : 0));
  return Math.max(0, ...widths);
}

function describeBand(figure, name, x) {
  const area = figure.areas?.find((one) => one.name === name);
  if (!area) return "";
  const k = area.x.indexOf(x);
  if (k < 0 || area.low[k] === null) return "";
  return ` (${formatDigits(area.low[k])} to ${formatDigits(area.high[k])})`;
}

export class Plot {
  // panel has a .plot and perhaps a .legend; onClick(x) gets the place that was clicked.
  constructor(panel, onClick) {
    this.box = panel.querySelector(".plot");
    this.legend = panel.querySelector(".legend");
    if (!this.legend) {
      this.legend = document.createElement("div");
      this.legend.className = "legend";
      this.box.after(this.legend);
    }
    this.onClick = onClick;
    new ResizeObserver(() => this.#resize()).observe(this.box);
  }

  draw(figure) {
    this.figure = figure;
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.#draw();
    });
  }

  // Draw everything again with the colours of today's theme.
  recolour() {
    this.shape = null;
    if (this.figure) this.draw(this.figure);
  }

  // Show a vertical line at a place of the x axis, none for null.
  setCursor(x) {
    if (!this.plot) return;
    this.cursor ??= document.createElement("div");
    this.cursor.className = "cursor";
    if (this.cursor.parentElement !== this.plot.over) this.plot.over.append(this.cursor);
    this.cursor.hidden = x === null;
    if (x !== null) this.cursor.style.left = `${this.plot.valToPos(x, "x")}px`;
  }

  clear() {
    this.plot?.destroy();
    this.plot = this.figure = this.shape = null;
    this.legend.replaceChildren();
  }

  #describeShape() {
    const { lines, areas, x, y } = this.figure;
    const parts = lines.map((l) => [l.name, l.points, l.dash, l.faint, l.end, l.colour, l.width]);
    return JSON.stringify([parts, (areas ?? []).map((a) => a.legend), x, y, this.#hasLabels()]);
  }

  #hasLabels() {
    return this.box.clientWidth >= NARROW && this.figure.lines.some((line) => line.end);
  }

  #draw() {
    const figure = this.figure;
    if (!figure) return;
    const shape = this.#describeShape();
    const data = figure.lines.length ? uPlot.join(figure.lines.map((l) => [l.x, l.y])) : [[0, 1]];
    this.box.setAttribute("role", "img");
    this.box.setAttribute("aria-label", figure.title);
    if (this.plot && this.shape === shape) {
      this.plot.batch(() => {
        this.plot.setData(data, false);
        this.#setScales();
        this.plot.redraw();
      });
      this.#writeValues();
      return;
    }
    this.shape = shape;
    this.plot?.destroy();
    this.#writeLegend();
    this.plot = new uPlot(this.#makeOptions(), data, this.box);
    this.plot.over.addEventListener("click", (event) => {
      this.onClick?.(this.plot.posToVal(event.offsetX, "x"));
    });
    requestAnimationFrame(() => this.#resize());
  }

  #makeOptions() {
    const figure = this.figure;
    const labels = this.#hasLabels();
    const right = labels ? measureEndLabels(figure) + LABEL_GAP + 4 : null;
    const makeScale = (name) => ({
      time: false,
      distr: figure[name].log ? 3 : 1,
      range: () => findRange(this.figure, name),
    });
    return {
      pxAlign: 0,
      width: this.box.clientWidth,
      height: this.#findHeight(),
      scales: { x: makeScale("x"), y: makeScale("y") },
      axes: [this.#makeAxis(figure.x, 26), this.#makeAxis(figure.y, 46)],
      series: [{}, ...figure.lines.map((line) => this.#makeSeries(line))],
      padding: [8, right, null, null],
      cursor: { drag: { x: false, y: false }, focus: { prox: 20 } },
      focus: { alpha: 0.6 },
      legend: { show: false },
      hooks: {
        drawClear: [(plot) => drawBelow(plot, this.figure)],
        draw: [(plot) => drawAbove(plot, this.figure, labels)],
        setCursor: [() => this.#writeValues()],
      },
    };
  }

  #makeAxis(axis, size) {
    const grid = { stroke: readStyle("grid"), width: 1 };
    return {
      label: axis.label,
      labelSize: 16,
      size,
      gap: 3,
      stroke: readStyle("quiet"),
      font: FONT,
      labelFont: "12px system-ui, sans-serif",
      grid,
      ticks: { ...grid, size: 4 },
      values: (_, ticks) => ticks.map((tick) => (tick === null ? "" : formatDigits(tick, 5))),
      splits: (_, __, low, high) => listTicks(low, high, axis.log),
      filter: (_, ticks) => ticks,
    };
  }

  #makeSeries(line) {
    const colour = readStyle(line.colour);
    return {
      label: line.name,
      stroke: colour,
      width: line.width ?? 1.5,
      dash: line.dash,
      spanGaps: true,
      alpha: line.faint ? 0.75 : 1,
      points: {
        show: Boolean(line.points),
        size: 6,
        fill: line.hollow ? readStyle("panel") : colour,
      },
    };
  }

  // The legend has a row for the place, the lines and those areas that have a name in it.
  #writeLegend() {
    const { lines, areas, x } = this.figure;
    const entries = [{ name: x.short ?? x.label, place: true }];
    for (const line of lines)
      if (line.name) entries.push({ name: line.name, colour: line.colour, dash: line.dash });
    for (const area of areas ?? []) {
      if (area.legend) entries.splice(2, 0, { name: area.legend, colour: area.colour, area: true });
    }
    this.legend.replaceChildren(...entries.map((entry) => this.#makeEntry(entry)));
  }

  #makeEntry(entry) {
    const item = document.createElement("span");
    item.className = "entry";
    if (entry.colour) {
      const swatch = document.createElement("i");
      swatch.className = entry.area ? "swatch area" : entry.dash ? "swatch dashed" : "swatch";
      swatch.style.setProperty("--own", readStyle(entry.colour));
      item.append(swatch);
    }
    const value = document.createElement("b");
    item.append(`${entry.name} `, value);
    item.dataset.name = entry.name;
    if (entry.place) item.classList.add("place");
    return item;
  }

  // Write the values at the pointer into the legend; nothing where there is no pointer.
  #writeValues() {
    const { plot, figure, legend } = this;
    if (!plot || !figure) return;
    const left = plot.cursor.left;
    const inside = left !== undefined && left !== null && left >= 0;
    const x = inside ? plot.posToVal(left, "x") : null;
    legend.classList.toggle("live", inside);
    for (const item of legend.children) {
      item.querySelector("b").textContent = inside
        ? this.#readValue(item.dataset.name, x, item)
        : "";
    }
  }

  #readValue(name, x, item) {
    const { lines, areas } = this.figure;
    if (item.classList.contains("place")) return formatDigits(x);
    const area = areas?.find((one) => one.legend === name);
    if (area) {
      const k = findNearest(area.x, x, area.low);
      return k < 0 ? "–" : `${formatDigits(area.low[k], 3)} to ${formatDigits(area.high[k], 3)}`;
    }
    const line = lines.find((one) => one.name === name);
    const k = line ? findNearest(line.x, x, line.y) : -1;
    if (k < 0) return "–";
    return (
      formatDigits(line.y[k], 3) +
      (areas?.some((one) => one.legend) ? "" : describeBand(this.figure, name, line.x[k]))
    );
  }

  #setScales() {
    for (const name of ["x", "y"]) {
      const [min, max] = findRange(this.figure, name);
      this.plot.setScale(name, { min, max });
    }
  }

  #findHeight() {
    return Math.max(90, this.box.clientHeight);
  }

  #resize() {
    if (!this.plot || !this.box.clientWidth) return;
    if (this.#describeShape() !== this.shape) {
      this.#draw();
      return;
    }
    this.plot.setSize({ width: this.box.clientWidth, height: this.#findHeight() });
  }
}

const escapeMarkup = (text) =>
  String(text).replace(
    /[&<>"]/g,
    (c) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" })[c],
  );

const dashAttribute = (dash) => (dash ? `stroke-dasharray="${dash.join(" ")}"` : "");

// Maps from values to places of a drawing of some size, with the label's margin at the right.
function makeFrame(figure, width, height) {
  const right = measureEndLabels(figure);
  const box = { left: 70, top: 40, width: width - 90 - right, height: height - 100 };
  const [x0, x1] = findRange(figure, "x");
  const [y0, y1] = findRange(figure, "y");
  const share = (v, low, high, log) =>
    log ? Math.log(v / low) / Math.log(high / low) : (v - low) / (high - low);
  return {
    box,
    limits: { x: [x0, x1], y: [y0, y1] },
    xOf: (v) => (box.left + box.width * share(v, x0, x1, figure.x.log)).toFixed(2),
    yOf: (v) => (box.top + box.height * (1 - share(v, y0, y1, figure.y.log))).toFixed(2),
  };
}

function tracePath(figure, frame, line) {
  let path = "";
  let drawing = false;
  line.x.forEach((x, k) => {
    const y = line.y[k];
    const usable = x !== null && y !== null && (!figure.y.log || y > 0);
    if (usable) path += `${drawing ? "L" : "M"}${frame.xOf(x)} ${frame.yOf(y)}`;
    drawing = usable || (drawing && !figure.broken);
  });
  return path;
}

function svgLegend(figure, left, width, top) {
  const parts = [];
  let x = left;
  let y = top;
  const entries = figure.lines.filter((line) => line.name);
  const areas = (figure.areas ?? []).filter((area) => area.legend);
  for (const entry of [...entries, ...areas]) {
    const name = entry.legend ?? entry.name;
    const length = 34 + 6.6 * name.length;
    if (x > left && x + length > width) {
      x = left;
      y += 18;
    }
    const colour = readStyle(entry.colour);
    if (entry.legend)
      parts.push(`<rect x="${x}" y="${y - 10}" width="18" height="10" fill="${colour}"/>`);
    else if (entry.width === 0)
      parts.push(`<circle cx="${x + 9}" cy="${y - 4}" r="3" fill="none" stroke="${colour}"/>`);
    else
      parts.push(
        `<path d="M${x} ${y - 4}h18" stroke-width="2" ${dashAttribute(entry.dash)} stroke="${colour}"/>`,
      );
    parts.push(`<text x="${x + 22}" y="${y}">${escapeMarkup(name)}</text>`);
    x += length;
  }
  return { parts, bottom: y };
}

function svgAxes(figure, frame) {
  const { box, limits, xOf, yOf } = frame;
  const parts = [];
  const grid = readStyle("grid");
  for (const v of listTicks(...limits.x, figure.x.log)) {
    parts.push(`<path d="M${xOf(v)} ${box.top}v${box.height}" stroke="${grid}"/>`);
    parts.push(
      `<text x="${xOf(v)}" y="${box.top + box.height + 16}" text-anchor="middle">${formatDigits(v)}</text>`,
    );
  }
  for (const v of listTicks(...limits.y, figure.y.log)) {
    parts.push(`<path d="M${box.left} ${yOf(v)}h${box.width}" stroke="${grid}"/>`);
    parts.push(
      `<text x="${box.left - 6}" y="${yOf(v)}" dy="4" text-anchor="end">${formatDigits(v)}</text>`,
    );
  }
  const middle = box.left + box.width / 2;
  const side = `translate(16 ${box.top + box.height / 2}) rotate(-90)`;
  parts.push(
    `<text x="${middle}" y="${box.top + box.height + 34}" text-anchor="middle">${escapeMarkup(figure.x.label)}</text>`,
  );
  parts.push(
    `<text transform="${side}" text-anchor="middle">${escapeMarkup(figure.y.label)}</text>`,
  );
  return parts;
}

function svgAreas(figure, frame) {
  const { box, xOf, yOf } = frame;
  const parts = [];
  for (const [from, to] of figure.spans ?? []) {
    parts.push(
      `<rect x="${xOf(from)}" y="${box.top}" width="${xOf(to) - xOf(from)}" height="${box.height}" fill="${readStyle("level")}" opacity=".16"/>`,
    );
  }
  for (const area of figure.areas ?? []) {
    const known = area.x
      .map((_, k) => k)
      .filter((k) => area.low[k] !== null && area.high[k] !== null);
    if (!known.length) continue;
    const upper = known.map((k) => `${xOf(area.x[k])} ${yOf(area.high[k])}`);
    const lower = known.reverse().map((k) => `${xOf(area.x[k])} ${yOf(area.low[k])}`);
    parts.push(
      `<path d="M${[...upper, ...lower].join("L")}Z" fill="${readStyle(area.colour)}" opacity="${area.strength ?? 1}"/>`,
    );
  }
  for (const level of figure.levels ?? []) {
    parts.push(
      `<path d="M${box.left} ${yOf(level.y)}h${box.width}" stroke="${readStyle(level.colour)}" stroke-dasharray="6 4"/>`,
    );
  }
  return parts;
}

function svgLines(figure, frame) {
  const { box, xOf, yOf } = frame;
  const parts = [];
  for (const line of [...figure.lines, ...(figure.branches ?? [])]) {
    const path = tracePath(figure, frame, line);
    parts.push(
      `<path d="${path}" stroke="${readStyle(line.colour)}" stroke-width="${line.width ?? 1.5}" ${dashAttribute(line.dash)} opacity="${line.faint ? 0.75 : 1}"/>`,
    );
  }
  for (const line of figure.lines.filter((one) => one.points)) {
    const fill = readStyle(line.hollow ? "panel" : line.colour);
    line.x.forEach((x, k) => {
      if (line.y[k] === null) return;
      parts.push(
        `<circle cx="${xOf(x)}" cy="${yOf(line.y[k])}" r="3" stroke="${readStyle(line.colour)}" fill="${fill}"/>`,
      );
    });
  }
  if (figure.ticks?.length) {
    const ticks = figure.ticks.map((t) => `M${xOf(t)} ${box.top + box.height}v-10`).join("");
    parts.push(`<path d="${ticks}" stroke="${readStyle("absorber")}" opacity=".4"/>`);
  }
  const text = readStyle("text");
  (figure.marks ?? []).forEach((mark, row) => {
    parts.push(
      `<path d="M${xOf(mark.x)} ${box.top}v${box.height}" stroke="${text}" stroke-dasharray="2 3"/>`,
    );
    if (mark.name) {
      parts.push(
        `<text x="${xOf(mark.x)}" dx="4" y="${box.top + 12 + 14 * row}" fill="${text}">${escapeMarkup(mark.name)}</text>`,
      );
    }
  });
  return parts;
}

export function svgOf(figure, width = 900, height = 560) {
  const frame = makeFrame(figure, width, height);
  const { box } = frame;
  const legend = svgLegend(figure, box.left, width, height - 10);
  const total = legend.bottom + 10;
  const labels = placeEndLabels(
    figure,
    (v) => Number(frame.yOf(v)),
    box.top,
    box.top + box.height,
    frame.limits.x,
  );
  const ends = labels.map(
    (label) =>
      `<text x="${box.left + box.width + LABEL_GAP}" y="${label.y + 4}" fill="${readStyle(label.colour)}">${escapeMarkup(label.text)}</text>`,
  );
  return [
    `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${width} ${total}" width="${width}" height="${total}" font-family="sans-serif" font-size="12" fill="${readStyle("text")}">`,
    `<rect width="100%" height="100%" fill="${readStyle("panel")}"/>`,
    `<text x="${box.left}" y="24" font-size="15">${escapeMarkup(figure.title)}</text>`,
    `<clipPath id="c"><rect x="${box.left}" y="${box.top}" width="${box.width}" height="${box.height}"/></clipPath>`,
    ...svgAxes(figure, frame),
    '<g clip-path="url(#c)" fill="none">',
    ...svgAreas(figure, frame),
    ...svgLines(figure, frame),
    "</g>",
    ...ends,
    ...legend.parts,
    "</svg>",
  ].join("");
}

export function csvOf(figure) {
  const rows = [["series", figure.x.label, figure.y.label]];
  for (const line of [...figure.lines, ...(figure.branches ?? [])]) {
    line.x.forEach((x, k) => {
      if (line.y[k] !== null) rows.push([line.name, x, line.y[k]]);
    });
  }
  for (const area of figure.areas ?? []) {
    area.x.forEach((x, k) => {
      if (area.low[k] === null) return;
      rows.push([`${area.name}, low`, x, area.low[k]], [`${area.name}, high`, x, area.high[k]]);
    });
  }
  const quote = (cell) => (/[",\n]/.test(cell) ? `"${String(cell).replaceAll('"', '""')}"` : cell);
  return `${rows.map((row) => row.map(quote).join(",")).join("\r\n")}\r\n`;
}

export function save(name, content, type) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(
    content instanceof Blob ? content : new Blob([content], { type }),
  );
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

export function savePng(name, figure) {
  const image = new Image();
  const url = URL.createObjectURL(new Blob([svgOf(figure)], { type: "image/svg+xml" }));
  image.onload = () => {
    const width = 1800;
    const height = Math.round((width * image.naturalHeight) / image.naturalWidth);
    const canvas = Object.assign(document.createElement("canvas"), { width, height });
    canvas.getContext("2d").drawImage(image, 0, 0, width, height);
    canvas.toBlob((blob) => save(name, blob));
    URL.revokeObjectURL(url);
  };
  image.src = url;
}
