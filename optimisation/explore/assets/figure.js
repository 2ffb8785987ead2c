// A figure is plain data: lines, areas, branches and marks, drawn by uPlot on the page and written as SVG, PNG or CSV from the same data.
const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
export const digits = (x, n = 4) => (x === null || x === undefined || !Number.isFinite(x) ? "–" : String(Number(x.toPrecision(n))));

function range(figure, axis) {
  const wanted = figure[axis].log ? (v) => Number.isFinite(v) && v > 0 : Number.isFinite;
  const found = [];
  const own = [...figure.lines, ...(figure.branches ?? [])].filter((line) => !line.beside && line[axis].length);
  for (const line of own.length ? own : figure.lines) found.push(...line[axis]); // what stands beside is cut off where it leaves

  for (const area of figure.areas ?? []) found.push(...(axis === "x" ? area.x : [...area.low, ...area.high]));
  if (axis === "x") found.push(...(figure.marks ?? []).filter((mark) => mark.name).map((mark) => mark.x));
  const good = found.filter((v) => v !== null && wanted(v));
  if (!good.length) return figure[axis].log ? [0.1, 10] : [0, 1];
  let low = Infinity, high = -Infinity;
  for (const v of good) { low = Math.min(low, v); high = Math.max(high, v); }
  if (axis === "x") return low < high ? [low, high] : [low - 1, high + 1];
  if (figure.y.log) return [low / 1.15, high * 1.25];
  const room = 0.06 * (high - low || Math.abs(high) || 1);
  return [figure.y.from === undefined ? low - room : figure.y.from, high + room];
}

function path(context, u, xs, ys) {
  context.beginPath();
  let down = false;
  xs.forEach((x, k) => {
    if (ys[k] === null || x === null) { down = false; return; }
    const at = [u.valToPos(x, "x", true), u.valToPos(ys[k], "y", true)];
    if (down) context.lineTo(...at); else context.moveTo(...at);
    down = true;
  });
}

// what lies below the lines, and what uPlot has no series for
function below(figure) {
  return (u) => {
    const c = u.ctx, { left, top, width, height } = u.bbox, x = (v) => u.valToPos(v, "x", true), y = (v) => u.valToPos(v, "y", true);
    c.save();
    c.beginPath(); c.rect(left, top, width, height); c.clip();
    for (const [from, to] of figure.spans ?? []) { c.fillStyle = style("level"); c.globalAlpha = 0.16; c.fillRect(x(from), top, x(to) - x(from), height); c.globalAlpha = 1; }
    for (const area of figure.areas ?? []) {
      c.fillStyle = style(area.colour);
      c.globalAlpha = area.strength ?? 1;
      c.beginPath();
      const good = area.x.map((_, k) => k).filter((k) => area.low[k] !== null && area.high[k] !== null);
      good.forEach((k, n) => (n ? c.lineTo(x(area.x[k]), y(area.high[k])) : c.moveTo(x(area.x[k]), y(area.high[k]))));
      good.reverse().forEach((k) => c.lineTo(x(area.x[k]), y(area.low[k])));
      c.fill();
      c.globalAlpha = 1;
    }
    for (const h of figure.levels ?? []) { c.strokeStyle = style(h.colour); c.setLineDash([6, 4]); c.lineWidth = 1.2; c.beginPath(); c.moveTo(left, y(h.y)); c.lineTo(left + width, y(h.y)); c.stroke(); c.setLineDash([]); }
    c.restore();
  };
}
function above(figure) {
  return (u) => {
    const c = u.ctx, { left, top, width, height } = u.bbox, ratio = devicePixelRatio;
    c.save();
    c.beginPath(); c.rect(left, top, width, height); c.clip();
    for (const line of figure.branches ?? []) {
      c.strokeStyle = style(line.colour); c.lineWidth = line.width * ratio;
      c.setLineDash(line.dash ? line.dash.map((d) => d * ratio) : []);
      path(c, u, line.x, line.y); c.stroke();
    }
    c.setLineDash([]);
    if (figure.ticks) {
      c.strokeStyle = style("absorber"); c.globalAlpha = Math.min(1, Math.max(0.12, 300 / figure.ticks.length)); c.lineWidth = ratio; c.beginPath();
      for (const t of figure.ticks) { const at = u.valToPos(t, "x", true); c.moveTo(at, top + height); c.lineTo(at, top + height - 10 * ratio); }
      c.stroke(); c.globalAlpha = 1;
    }
    for (const [k, mark] of (figure.marks ?? []).entries()) {
      const at = u.valToPos(mark.x, "x", true);
      if (mark.name) { c.fillStyle = style("text"); c.font = `${12 * ratio}px system-ui`; c.textAlign = "left"; c.fillText(mark.name, at + 4 * ratio, top + (12 + 14 * k) * ratio); }
      c.strokeStyle = style("text"); c.lineWidth = ratio; c.setLineDash([2 * ratio, 3 * ratio]); c.beginPath(); c.moveTo(at, top); c.lineTo(at, top + height); c.stroke(); c.setLineDash([]);
      if (mark.y) { c.fillStyle = style("text"); c.beginPath(); c.arc(at, u.valToPos(mark.y, "y", true), 4 * ratio, 0, 7); c.fill(); }
    }
    c.restore();
  };
}

export class Plot {
  constructor(panel, onClick) {
    this.box = panel.querySelector(".plot");
    this.panel = panel;
    this.onClick = onClick;
    new ResizeObserver(() => this.#resize()).observe(this.box);
  }

  draw(figure) {
    this.figure = figure;
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => { this.waiting = false; this.#draw(); });
  }

  #draw() {
    const figure = this.figure, shape = JSON.stringify([figure.lines.map((l) => [l.name, l.points, l.dash, l.faint]), figure.y, figure.x]);
    const data = figure.lines.length ? uPlot.join(figure.lines.map((l) => [l.x, l.y])) : [[0, 1]];
    if (this.plot && this.shape === shape) {
      this.plot.batch(() => { this.plot.setData(data, false); this.#scale(); this.plot.redraw(); });
      return;
    }
    this.shape = shape;
    this.plot?.destroy();
    const axis = (of) => ({ label: of.label, labelSize: 16, size: of === figure.y ? 46 : 26, gap: 3, stroke: style("quiet"), font: "11px system-ui", labelFont: "12px system-ui",
      grid: { stroke: style("grid"), width: 1 }, ticks: { stroke: style("grid"), width: 1, size: 4 }, values: (_, all) => all.map((v) => (v === null ? "" : digits(v, 5))),
      splits: (_, __, low, high) => steps(low, high, of.log), filter: (_, splits) => splits });
    const scale = (name) => ({ time: false, distr: figure[name].log ? 3 : 1, range: () => range(this.figure, name) });
    this.plot = new uPlot({
      pxAlign: 0, width: this.box.clientWidth, height: this.#height(), scales: { x: scale("x"), y: scale("y") }, axes: [axis(figure.x), axis(figure.y)],
      series: [{ label: figure.x.short, value: (_, v) => digits(v) }, ...figure.lines.map((l) => ({
        label: l.name, stroke: style(l.colour), width: l.width ?? 1.5, dash: l.dash, spanGaps: true, alpha: l.faint ? 0.75 : 1,
        points: { show: Boolean(l.points), size: 6, fill: l.hollow ? style("panel") : style(l.colour) }, value: (u, v, _, at) => digits(v) + bandAt(this.figure, l.name, u.data[0][at]),
      }))],
      padding: [8, null, null, null], cursor: { drag: { x: false, y: false }, focus: { prox: 20 } }, focus: { alpha: 0.6 }, legend: { live: true },
      hooks: { drawClear: [(u) => below(this.figure)(u)], draw: [(u) => above(this.figure)(u)] },
    }, data, this.box);
    this.plot.over.addEventListener("click", (event) => this.onClick?.(this.plot.posToVal(event.offsetX, "x")));
    requestAnimationFrame(() => this.#resize());
  }

  #scale() { for (const name of ["x", "y"]) { const [min, max] = range(this.figure, name); this.plot.setScale(name, { min, max }); } }
  #height() { return Math.max(120, this.box.clientHeight - (this.box.querySelector(".u-legend")?.offsetHeight ?? 24)); }
  #resize() { if (this.plot && this.box.clientWidth) this.plot.setSize({ width: this.box.clientWidth, height: this.#height() }); }
  recolour() { this.shape = null; if (this.figure) this.draw(this.figure); }
}

function bandAt(figure, name, x) {
  const area = figure.areas?.find((a) => a.name === name), k = area ? area.x.indexOf(x) : -1;
  return k < 0 || area.low[k] === null ? "" : ` (${digits(area.low[k])} to ${digits(area.high[k])})`;
}

const escaped = (text) => String(text).replace(/[&<>"]/g, (c) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" })[c]);

function steps(low, high, log) {
  if (log && high > 3 * low) {
    const all = [], shown = high > 1e3 * low ? [1] : high > 8 * low ? [1, 2, 5] : [1, 1.5, 2, 3, 4, 5, 7];
    for (let e = Math.floor(Math.log10(low)); e <= Math.log10(high); e++) for (const m of shown) if (m * 10 ** e >= low && m * 10 ** e <= high) all.push(m * 10 ** e);
    return all;
  }
  const raw = (high - low) / 6, unit = 10 ** Math.floor(Math.log10(raw)), step = unit * [1, 2, 5, 10].find((m) => m * unit >= raw), all = [];
  for (let v = Math.ceil(low / step) * step; v <= high + 1e-9 * step; v += step) all.push(Number(v.toPrecision(12)));
  return all;
}

export function svgOf(figure, width = 900, height = 560) {
  const box = { left: 70, top: 40, width: width - 90, height: height - 100 }, [x0, x1] = range(figure, "x"), [y0, y1] = range(figure, "y");
  const place = (v, low, high, log) => (log ? Math.log(v / low) / Math.log(high / low) : (v - low) / (high - low));
  const X = (v) => (box.left + box.width * place(v, x0, x1, figure.x.log)).toFixed(2), Y = (v) => (box.top + box.height * (1 - place(v, y0, y1, figure.y.log))).toFixed(2);
  const trace = (xs, ys) => { let d = "", down = false; xs.forEach((x, k) => { const ok = x !== null && ys[k] !== null && (!figure.y.log || ys[k] > 0); if (ok) d += `${down ? "L" : "M"}${X(x)} ${Y(ys[k])}`; down = ok || (down && !figure.broken); }); return d; };
  const legend = [];
  let at = box.left, low = height - 10;
  for (const line of figure.lines) {
    const length = 34 + 6.6 * line.name.length;
    if (at > box.left && at + length > width) { at = box.left; low += 18; }
    const own = line.width === 0 ? `<circle cx="${at + 9}" cy="${low - 4}" r="3" fill="none"` : `<path d="M${at} ${low - 4}h18" stroke-width="2" ${line.dash ? `stroke-dasharray="${line.dash.join(" ")}"` : ""}`;
    legend.push(`${own} stroke="${style(line.colour)}"/><text x="${at + 22}" y="${low}">${escaped(line.name)}</text>`);
    at += length;
  }
  const parts = [`<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${width} ${low + 10}" width="${width}" height="${low + 10}" font-family="sans-serif" font-size="12" fill="${style("text")}">`,
    `<rect width="100%" height="100%" fill="${style("panel")}"/><text x="${box.left}" y="24" font-size="15">${escaped(figure.title)}</text>`,
    `<clipPath id="c"><rect x="${box.left}" y="${box.top}" width="${box.width}" height="${box.height}"/></clipPath>`];
  for (const v of steps(x0, x1, figure.x.log)) parts.push(`<path d="M${X(v)} ${box.top}v${box.height}" stroke="${style("grid")}"/><text x="${X(v)}" y="${box.top + box.height + 16}" text-anchor="middle">${digits(v)}</text>`);
  for (const v of steps(y0, y1, figure.y.log)) parts.push(`<path d="M${box.left} ${Y(v)}h${box.width}" stroke="${style("grid")}"/><text x="${box.left - 6}" y="${Y(v)}" dy="4" text-anchor="end">${digits(v)}</text>`);
  parts.push(`<text x="${box.left + box.width / 2}" y="${box.top + box.height + 34}" text-anchor="middle">${escaped(figure.x.label)}</text><text transform="translate(16 ${box.top + box.height / 2}) rotate(-90)" text-anchor="middle">${escaped(figure.y.label)}</text><g clip-path="url(#c)" fill="none">`);
  for (const [a, b] of figure.spans ?? []) parts.push(`<rect x="${X(a)}" y="${box.top}" width="${X(b) - X(a)}" height="${box.height}" fill="${style("level")}" opacity=".16"/>`);
  for (const area of figure.areas ?? []) {
    const good = area.x.map((_, k) => k).filter((k) => area.low[k] !== null && area.high[k] !== null);
    if (good.length) parts.push(`<path d="M${[...good.map((k) => `${X(area.x[k])} ${Y(area.high[k])}`), ...[...good].reverse().map((k) => `${X(area.x[k])} ${Y(area.low[k])}`)].join("L")}Z" fill="${style(area.colour)}" opacity="${area.strength ?? 1}"/>`);
  }
  for (const h of figure.levels ?? []) parts.push(`<path d="M${box.left} ${Y(h.y)}h${box.width}" stroke="${style(h.colour)}" stroke-dasharray="6 4"/>`);
  for (const line of [...figure.lines, ...(figure.branches ?? [])]) parts.push(`<path d="${trace(line.x, line.y)}" stroke="${style(line.colour)}" stroke-width="${line.width ?? 1.5}" ${line.dash ? `stroke-dasharray="${line.dash.join(" ")}"` : ""} opacity="${line.faint ? 0.75 : 1}"/>`);
  for (const line of figure.lines.filter((l) => l.points)) line.x.forEach((x, k) => { if (line.y[k] !== null) parts.push(`<circle cx="${X(x)}" cy="${Y(line.y[k])}" r="3" stroke="${style(line.colour)}" fill="${style(line.hollow ? "panel" : line.colour)}"/>`); });
  if (figure.ticks) parts.push(`<path d="${figure.ticks.map((t) => `M${X(t)} ${box.top + box.height}v-10`).join("")}" stroke="${style("absorber")}" opacity=".4"/>`);
  for (const [k, mark] of (figure.marks ?? []).entries()) parts.push(`<path d="M${X(mark.x)} ${box.top}v${box.height}" stroke="${style("text")}" stroke-dasharray="2 3"/>${mark.name ? `<text x="${X(mark.x)}" dx="4" y="${box.top + 12 + 14 * k}" fill="${style("text")}">${escaped(mark.name)}</text>` : ""}`);
  parts.push("</g>");
  parts.push(...legend);
  return `${parts.join("")}</svg>`;
}

export function csvOf(figure) {
  const rows = [["series", figure.x.label, figure.y.label]];
  for (const line of [...figure.lines, ...(figure.branches ?? [])]) line.x.forEach((x, k) => { if (line.y[k] !== null) rows.push([line.name, x, line.y[k]]); });
  for (const area of figure.areas ?? []) area.x.forEach((x, k) => { if (area.low[k] !== null) rows.push([`${area.name}, low`, x, area.low[k]], [`${area.name}, high`, x, area.high[k]]); });
  return rows.map((row) => row.map((cell) => (/[",\n]/.test(cell) ? `"${String(cell).replaceAll('"', '""')}"` : cell)).join(",")).join("\r\n") + "\r\n";
}

export function save(name, content, type) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(content instanceof Blob ? content : new Blob([content], { type }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

export function savePng(name, figure) {
  const image = new Image(), url = URL.createObjectURL(new Blob([svgOf(figure)], { type: "image/svg+xml" }));
  image.onload = () => {
    const canvas = Object.assign(document.createElement("canvas"), { width: 1800, height: 1120 });
    canvas.getContext("2d").drawImage(image, 0, 0, 1800, 1120);
    canvas.toBlob((blob) => save(name, blob));
    URL.revokeObjectURL(url);
  };
  image.src = url;
}
