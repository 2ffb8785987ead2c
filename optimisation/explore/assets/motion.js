// The structure with the absorber in its cavity around an instant, slowed: a pseudo period takes SLOW seconds. Impacts flash.
const SLOW = 1.6, FLASH = 0.05; // s, of a pseudo period
const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
const dot = (a, b) => a.reduce((sum, x, k) => sum + x * b[k], 0);

export class Motion {
  constructor(panel) {
    this.canvas = panel.querySelector("canvas");
    this.moment = panel.querySelector("#moment");
    this.button = panel.querySelector("#play");
    this.playing = !matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.at = 0;
    this.button.addEventListener("click", () => this.play(!this.playing));
    this.moment.addEventListener("input", () => { this.play(false); this.at = (this.moment.value / 1000) * this.length; this.draw(); });
    this.play(this.playing);
  }

  get length() { return this.data ? this.data.time.at(-1) - this.data.time[0] : 1; }

  play(on) {
    this.playing = on;
    this.button.textContent = on ? "Pause" : "Play";
    this.button.setAttribute("aria-pressed", on);
    if (on && !this.ticking) { this.last = performance.now(); this.ticking = true; requestAnimationFrame((t) => this.tick(t)); }
  }

  show(data) {
    this.data = data.time.length > 1 ? data : null;
    if (!this.data) return;
    const places = data.place_shapes.map((shape) => data.modal.map((q) => dot(q, shape)));
    this.relative = places.map((place, a) => (data.absorbers ? data.absorbers.map((row, k) => row[a] - place[k]) : null));
    const most = (rows) => rows.reduce((m, row) => Math.max(m, ...row.map(Math.abs)), 1e-12);
    this.shape = data.shapes ? data.modal.map((q) => data.shapes.map((shape) => dot(q, shape))) : places[0].map((_, k) => places.map((p) => p[k]));
    this.scale = most(this.shape);
    this.width = data.gaps.map((gap, a) => gap ?? (this.relative[a] ? 1.1 * most([this.relative[a]]) : 1));
    if (this.at > this.length) this.at = 0;
    this.draw();
  }

  tick(now) {
    if (!this.playing) { this.ticking = false; return; }
    if (this.data) {
      this.at = (this.at + (((now - this.last) / 1000) * this.data.period) / SLOW) % this.length;
      this.moment.value = (1000 * this.at) / this.length;
      this.draw();
    }
    this.last = now;
    requestAnimationFrame((t) => this.tick(t));
  }

  draw() {
    const { canvas, data } = this, ratio = devicePixelRatio, W = canvas.clientWidth, H = canvas.clientHeight;
    if (!W || !H) return;
    canvas.width = W * ratio; canvas.height = H * ratio;
    const c = canvas.getContext("2d");
    c.scale(ratio, ratio);
    if (!data) return;
    const time = data.time[0] + this.at;
    let k = 0, end = data.time.length - 1;
    while (end - k > 1) { const middle = (k + end) >> 1; if (data.time[middle] <= time) k = middle; else end = middle; }
    const share = (time - data.time[k]) / (data.time[k + 1] - data.time[k]), between = (rows) => rows[k].map((v, i) => v + share * (rows[k + 1][i] - v));
    const shape = between(this.shape), cavities = data.absorbers ? data.gaps.length : 0, beamW = cavities ? W * 0.55 : W - 30, mid = H / 2, tall = H * 0.36;
    c.font = "11px system-ui"; c.fillStyle = style("quiet");
    c.fillText(`structure, deflection up to ${(1e3 * this.scale).toPrecision(3)} mm`, 12, 14);
    const y = (v) => mid - (tall * v) / this.scale, along = data.along ?? data.places.map((_, a) => (a + 1) / data.places.length), x = (s) => 20 + s * (beamW - 50);
    c.strokeStyle = style("grid"); c.lineWidth = 1; c.beginPath(); c.moveTo(20, mid); c.lineTo(x(1), mid); c.stroke();
    c.strokeStyle = style("tip"); c.lineWidth = 4; c.beginPath();
    if (data.along) along.forEach((s, i) => (i ? c.lineTo(x(s), y(shape[i])) : c.moveTo(x(s), y(shape[i]))));
    else along.forEach((s, i) => { c.moveTo(x(s) - 14, y(shape[i])); c.lineTo(x(s) + 14, y(shape[i])); });
    c.stroke();
    for (let a = 0; a < cavities; a++) {
      const s = data.along ? data.places[a] : along[a], near = data.along ? Math.round(s * (along.length - 1)) : a, relative = this.relative[a][k] + share * (this.relative[a][k + 1] - this.relative[a][k]);
      const px = x(s), py = y(shape[near]), struck = data.impacts.some((t, n) => data.struck[n] === a && Math.abs(time - t) < FLASH * data.period);
      const half = 13, move = Math.max(-1, Math.min(1, relative / this.width[a]));
      if (data.gaps[a] !== null) { c.strokeStyle = style("wall"); c.lineWidth = 2; c.strokeRect(px - 9, py - half, 18, 2 * half); }
      c.fillStyle = style(struck ? "flash" : "absorber"); c.beginPath(); c.arc(px, py - move * (half - 5), 5, 0, 7); c.fill();
      // the cavity, enlarged
      const top = 24 + (a * (H - 30)) / cavities, h = (H - 44) / cavities - 10, cx = W * 0.55 + (W * 0.45) / 2, cy = top + h / 2, w = Math.min(120, W * 0.2), body = Math.min(26, h / 5), room = h / 2 - body / 2 - 4;
      c.fillStyle = style("quiet"); c.fillText(data.gaps[a] === null ? "absorber relative to its place" : `cavity${cavities > 1 ? ` ${a + 1}` : ""}, ±${(1e3 * data.gaps[a]).toPrecision(3)} mm`, cx - w / 2, top - 8);
      if (data.gaps[a] !== null) {
        for (const side of [-1, 1]) {
          const hit = struck && Math.sign(relative) === side;
          c.strokeStyle = style(hit ? "flash" : "wall"); c.lineWidth = hit ? 7 : 4; c.beginPath(); c.moveTo(cx - w / 2, cy - side * (h / 2)); c.lineTo(cx + w / 2, cy - side * (h / 2)); c.stroke();
        }
        c.strokeStyle = style("wall"); c.lineWidth = 1; c.strokeRect(cx - w / 2, cy - h / 2, w, h);
      } else { c.strokeStyle = style("grid"); c.lineWidth = 1; c.strokeRect(cx - w / 2, cy - h / 2, w, h); }
      c.fillStyle = style(struck ? "flash" : "absorber");
      c.fillRect(cx - w / 4, cy - move * room - body / 2, w / 2, body);
    }
    c.fillStyle = style("quiet");
    c.fillText(`${time.toPrecision(6)} s, ${(this.at / data.period).toFixed(1)} of ${(this.length / data.period).toFixed(0)} periods, slowed ${Math.max(1, Math.round(SLOW / data.period))} times`, 12, H - 6);
  }
}
