// The structure with its absorbers in their cavities, slowed: around an instant, or through the whole run. Impacts flash.

const PERIOD_SECONDS = 1.6; // of the screen for a period around an instant
const WHOLE_PERIOD_SECONDS = 0.35; // the same in the whole run, of which a period is drawn here and there
const FLASH_PERIODS = 0.05;
const FONT = "11px system-ui, sans-serif";
const LINE = 14; // px
const MOST_CAVITIES = 4; // enlarged beside the structure

const readStyle = (name) =>
  getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
const dot = (a, b) => a.reduce((sum, x, k) => sum + x * b[k], 0);
const findLargest = (rows) =>
  rows.reduce((most, row) => Math.max(most, ...row.map(Math.abs)), 1e-12);

// Return the displacements that are drawn, from a message of the server with modal displacements.
function prepareRun(data) {
  const places = data.place_shapes.map((shape) => data.modal.map((q) => dot(q, shape)));
  const relative = places.map((place, a) => {
    return data.absorbers ? data.absorbers.map((row, k) => row[a] - place[k]) : null;
  });
  const shapes = data.shapes ?? data.place_shapes;
  const shape = data.modal.map((q) => shapes.map((row) => dot(q, row)));
  const widths = data.gaps.map((gap, a) => {
    return gap ?? (relative[a] ? 1.1 * findLargest([relative[a]]) : 1);
  });
  const part = data.part ?? data.time.length;
  return { ...data, part, relative, shape, widths, scale: findLargest(shape) };
}

// Return the text cut to a width, with dots at its end where it was longer.
function fitText(context, text, width) {
  if (context.measureText(text).width <= width) return text;
  let end = text.length;
  while (end > 1 && context.measureText(`${text.slice(0, end)}…`).width > width) end--;
  return `${text.slice(0, end)}…`;
}

export class Motion {
  // onTime(time) is called with the drawn time in s of the run, null while there is none.
  constructor(panel, onTime) {
    this.canvas = panel.querySelector("canvas");
    this.slider = panel.querySelector("#moment");
    this.button = panel.querySelector("#play");
    this.extent = panel.querySelector("#extent");
    this.onTime = onTime;
    this.runs = { part: null, whole: null };
    this.at = 0; // s of the screen since the beginning
    this.button.addEventListener("click", () => this.play(!this.playing));
    this.extent.addEventListener("change", () => this.restart());
    this.slider.addEventListener("input", () => {
      this.play(false);
      this.at = (this.slider.value / 1000) * this.duration;
      this.draw();
    });
    new ResizeObserver(() => this.draw()).observe(this.canvas);
    this.play(!matchMedia("(prefers-reduced-motion: reduce)").matches);
  }

  get run() {
    return this.runs[this.extent.value];
  }

  get isWhole() {
    return this.extent.value === "whole";
  }

  get duration() {
    if (!this.run) return 1;
    const { time, part, period } = this.run;
    if (this.isWhole) return (time.length / part) * WHOLE_PERIOD_SECONDS;
    return ((time.at(-1) - time[0]) / period) * PERIOD_SECONDS;
  }

  show(extent, data) {
    this.runs[extent] = data.time.length > 1 ? prepareRun(data) : null;
    if (this.at > this.duration) this.at = 0;
    if (extent === this.extent.value) this.draw();
  }

  restart() {
    this.at = 0;
    this.draw();
  }

  play(on) {
    this.playing = on;
    this.button.textContent = on ? "Pause" : "Play";
    this.button.setAttribute("aria-pressed", on);
    if (on && !this.isTicking) {
      this.isTicking = true;
      this.lastTick = performance.now();
      requestAnimationFrame((now) => this.tick(now));
    }
  }

  tick(now) {
    if (!this.playing) {
      this.isTicking = false;
      return;
    }
    if (this.run && !document.hidden) {
      this.at = (this.at + (now - this.lastTick) / 1000) % this.duration;
      this.slider.value = (1000 * this.at) / this.duration;
      this.draw();
    }
    this.lastTick = now;
    requestAnimationFrame((later) => this.tick(later));
  }

  // Return the row before the moment, the share of the way to the next one, and the time in s.
  findMoment() {
    const { time, part, period } = this.run;
    if (this.isWhole) {
      const parts = time.length / part;
      const place = Math.min((this.at / this.duration) * parts, parts - 1e-9);
      const inside = (place % 1) * (part - 1);
      const k = Math.floor(place) * part + Math.floor(inside);
      const share = inside % 1;
      return { k, share, time: time[k] + share * (time[k + 1] - time[k]) };
    }
    const now = time[0] + (this.at / PERIOD_SECONDS) * period;
    let k = 0;
    let end = time.length - 1;
    while (end - k > 1) {
      const middle = (k + end) >> 1;
      if (time[middle] <= now) k = middle;
      else end = middle;
    }
    const share = Math.min(1, Math.max(0, (now - time[k]) / (time[k + 1] - time[k])));
    return { k, share, time: now };
  }

  draw() {
    const { canvas, run } = this;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (!width || !height) return;
    canvas.width = width * devicePixelRatio;
    canvas.height = height * devicePixelRatio;
    const context = canvas.getContext("2d");
    context.scale(devicePixelRatio, devicePixelRatio);
    context.font = FONT;
    if (!run) return;
    const moment = this.findMoment();
    this.onTime(this.isWhole ? moment.time : null);
    const absorbers = this.readAbsorbers(moment);
    const shape = run.shape[moment.k].map(
      (v, i) => v + moment.share * (run.shape[moment.k + 1][i] - v),
    );
    const enlarged = Math.min(absorbers.length, MOST_CAVITIES);
    const left = enlarged ? Math.max(width * 0.55, width - 190) : width;
    const area = { left: 12, right: left - 12, top: LINE + 10, bottom: height - LINE - 10 };
    if (run.ring) this.drawRing(context, area, shape, absorbers);
    else this.drawStructure(context, area, shape, absorbers);
    for (let a = 0; a < enlarged; a++) {
      const slot = (height - LINE - 10) / enlarged;
      const box = { left, right: width - 8, top: a * slot + 4, bottom: (a + 1) * slot };
      this.drawCavity(context, box, absorbers[a], a, absorbers.length);
    }
    this.drawCaptions(context, left, width, height, moment.time);
  }

  readAbsorbers({ k, share, time }) {
    const { run } = this;
    if (!run.absorbers) return [];
    return run.gaps.map((gap, a) => {
      const row = run.relative[a];
      const relative = row[k] + share * (row[k + 1] - row[k]);
      const isStruck = run.impacts.some((t, n) => {
        return run.struck[n] === a && Math.abs(time - t) < FLASH_PERIODS * run.period;
      });
      return { gap, relative, isStruck, move: Math.max(-1, Math.min(1, relative / run.widths[a])) };
    });
  }

  drawCaptions(context, left, width, height, time) {
    const { run } = this;
    context.fillStyle = readStyle("quiet");
    context.textAlign = "left";
    const scale = `deflection up to ${(1e3 * run.scale).toPrecision(3)} mm`;
    context.fillText(fitText(context, scale, left - 20), 12, LINE);
    const seconds = this.isWhole ? WHOLE_PERIOD_SECONDS : PERIOD_SECONDS;
    const slowed = Math.max(1, Math.round(seconds / run.period));
    const text = `${time.toPrecision(4)} s, slowed ${slowed} times`;
    context.fillText(fitText(context, text, width - 20), 12, height - 5);
  }

  drawStructure(context, area, shape, absorbers) {
    const { run } = this;
    const middle = (area.top + area.bottom) / 2;
    const tall = (area.bottom - area.top) / 2 - 16;
    const count = shape.length;
    const along = run.along ?? shape.map((_, a) => (a + 0.5) / count);
    const xOf = (s) => area.left + s * (area.right - area.left - 12);
    const yOf = (v) => middle - (tall * v) / run.scale;
    context.strokeStyle = readStyle("grid");
    context.lineWidth = 1;
    context.beginPath();
    context.moveTo(xOf(0), middle);
    context.lineTo(xOf(1), middle);
    context.stroke();
    context.strokeStyle = readStyle("tip");
    context.lineWidth = 4;
    context.beginPath();
    along.forEach((s, i) => {
      if (!run.along) {
        context.moveTo(xOf(s) - 14, yOf(shape[i]));
        context.lineTo(xOf(s) + 14, yOf(shape[i]));
      } else if (i) context.lineTo(xOf(s), yOf(shape[i]));
      else context.moveTo(xOf(s), yOf(shape[i]));
    });
    context.stroke();
    absorbers.forEach((absorber, a) => {
      const s = run.along ? run.places[a] : along[a];
      const near = run.along ? Math.round(s * (along.length - 1)) : a;
      this.drawSmallCavity(context, xOf(s), yOf(shape[near]), absorber);
    });
  }

  drawSmallCavity(context, x, y, absorber) {
    const half = 13;
    if (absorber.gap !== null) {
      context.strokeStyle = readStyle("wall");
      context.lineWidth = 2;
      context.strokeRect(x - 9, y - half, 18, 2 * half);
    }
    context.fillStyle = readStyle(absorber.isStruck ? "flash" : "absorber");
    context.beginPath();
    context.arc(x, y - absorber.move * (half - 5), 5, 0, 7);
    context.fill();
  }

  // Sectors stand around a circle; a sector moves outwards for a positive displacement.
  drawRing(context, area, shape, absorbers) {
    const { run } = this;
    const centre = { x: (area.left + area.right) / 2, y: (area.top + area.bottom) / 2 };
    const outer = Math.min(area.right - area.left, area.bottom - area.top) / 2 - 4;
    const radius = outer * 0.68;
    const reach = outer * 0.2;
    const count = shape.length;
    const angleOf = (s) => (2 * Math.PI * s) / count - Math.PI / 2;
    const pointOf = (s, r) => [
      centre.x + r * Math.cos(angleOf(s)),
      centre.y + r * Math.sin(angleOf(s)),
    ];
    context.strokeStyle = readStyle("grid");
    context.lineWidth = 1;
    context.beginPath();
    context.arc(centre.x, centre.y, radius, 0, 2 * Math.PI);
    context.stroke();
    context.strokeStyle = readStyle("tip");
    context.lineWidth = 3;
    context.beginPath();
    for (let s = 0; s <= count; s++) {
      const point = pointOf(s, radius + (reach * shape[s % count]) / run.scale);
      if (s) context.lineTo(...point);
      else context.moveTo(...point);
    }
    context.stroke();
    absorbers.forEach((absorber, a) => {
      const sector = run.sectors?.[a] ?? a;
      const r = radius + (reach * shape[sector]) / run.scale;
      this.drawRadialCavity(context, pointOf(sector, r), angleOf(sector), absorber, outer);
    });
  }

  drawRadialCavity(context, point, angle, absorber, outer) {
    const half = Math.max(7, outer * 0.1);
    context.save();
    context.translate(...point);
    context.rotate(angle);
    context.fillStyle = readStyle("panel");
    context.strokeStyle = readStyle("wall");
    context.lineWidth = 1.5;
    context.fillRect(-half, -half * 0.6, 2 * half, 1.2 * half);
    context.strokeRect(-half, -half * 0.6, 2 * half, 1.2 * half);
    context.fillStyle = readStyle(absorber.isStruck ? "flash" : "absorber");
    context.beginPath();
    context.arc(absorber.move * (half - 0.4 * half), 0, 0.4 * half, 0, 7);
    context.fill();
    context.restore();
  }

  drawCavity(context, box, absorber, index, count) {
    const width = Math.min(120, box.right - box.left - 10);
    const centre = (box.left + box.right) / 2;
    const top = box.top + LINE + 4;
    const height = Math.max(20, box.bottom - top - 4);
    const middle = top + height / 2;
    const body = Math.min(26, height / 4);
    const travel = height / 2 - body / 2 - 4;
    const number = count > 1 ? ` ${index + 1}` : "";
    const gap =
      absorber.gap === null
        ? "relative motion"
        : `cavity${number} ±${(1e3 * absorber.gap).toPrecision(3)} mm`;
    context.fillStyle = readStyle("quiet");
    context.textAlign = "center";
    context.fillText(fitText(context, gap, box.right - box.left), centre, box.top + LINE - 4);
    const hasWalls = absorber.gap !== null;
    context.strokeStyle = readStyle(hasWalls ? "wall" : "grid");
    context.lineWidth = 1;
    context.strokeRect(centre - width / 2, top, width, height);
    for (const side of hasWalls ? [-1, 1] : []) {
      const isHit = absorber.isStruck && Math.sign(absorber.relative) === side;
      context.strokeStyle = readStyle(isHit ? "flash" : "wall");
      context.lineWidth = isHit ? 7 : 4;
      context.beginPath();
      context.moveTo(centre - width / 2, middle - (side * height) / 2);
      context.lineTo(centre + width / 2, middle - (side * height) / 2);
      context.stroke();
    }
    context.fillStyle = readStyle(absorber.isStruck ? "flash" : "absorber");
    context.fillRect(
      centre - width / 4,
      middle - absorber.move * travel - body / 2,
      width / 2,
      body,
    );
  }
}
