// Draws the offset of one pair over the last minutes: a line, its error band, the tolerance and the state below.

import { STATES, duration, offset } from "./words.js";

const T = 0, STATE = 1, OFFSET = 2, SIGMA = 3, LOW = 4, HIGH = 5, TOLERANCE = 6; // of a row
const STEP_MS = 500;
const GAP_MS = 1600;
const BAND_SIGMAS = 2;
const LEFT = 52, RIGHT = 14, TOP = 12, STRIP = 14, AXIS = 22;
const LEGEND = "line and band: offset ± 2 standard errors; green: tolerated; below: the state";
const LEAST_MS = 1;
const SPANS_S = { 60: 15, 120: 30, 300: 60 }; // how much time is shown, and how often it is marked

export class Chart {
  constructor(canvas, readout, pair) {
    this.canvas = canvas;
    this.readout = readout;
    this.pair = pair;
    this.rows = [];
    this.nowMs = null;
    this.keptS = this.spanS = 300;
    this.pointer = null;
    new ResizeObserver(() => this.draw()).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
    for (const name of ["pointermove", "pointerdown"]) canvas.addEventListener(name, (event) => this.point(event));
    canvas.addEventListener("pointercancel", () => this.point(null));
    canvas.addEventListener("pointerleave", (event) => event.pointerType === "mouse" && this.point(null));
  }

  clear() {
    this.rows = [];
    this.nowMs = null;
  }

  /** Adds rows; one with the time of the last takes its place. */
  add(rows, keptS) {
    this.keptS = keptS;
    for (const row of rows) {
      if (this.rows.length && this.rows[this.rows.length - 1][T] === row[T]) this.rows.pop();
      this.rows.push(row);
    }
    const oldest = (rows.length ? rows[rows.length - 1][T] : 0) - keptS * 1000;
    while (this.rows.length && this.rows[0][T] < oldest) this.rows.shift();
  }

  tick(nowMs) {
    this.nowMs = nowMs;
    this.draw();
  }

  point(event) {
    this.pointer = event && event.clientX - this.canvas.getBoundingClientRect().left;
    this.draw();
  }

  draw() {
    const { canvas } = this;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width || !height || this.nowMs === null) return;
    const scale = window.devicePixelRatio || 1;
    const pixels = [Math.round(width * scale), Math.round(height * scale)];
    if (canvas.width !== pixels[0] || canvas.height !== pixels[1]) [canvas.width, canvas.height] = pixels;
    const style = getComputedStyle(canvas);
    this.colour = (name) => style.getPropertyValue(`--${name}`).trim();
    this.font = `12px ${style.fontFamily}`;
    const pen = canvas.getContext("2d");
    pen.setTransform(scale, 0, 0, scale, 0, 0);
    pen.clearRect(0, 0, width, height);
    const plot = { left: LEFT, right: width - RIGHT, top: TOP, bottom: height - AXIS - STRIP };
    const range = this.range();
    this.spanS = this.span();
    const x = (ms) => plot.right - ((this.nowMs - ms) / (this.spanS * 1000)) * (plot.right - plot.left);
    const y = (ms) => plot.bottom - ((ms - range.low) / (range.high - range.low)) * (plot.bottom - plot.top);
    this.drawGrid(pen, plot, range, x, y);
    pen.save();
    pen.beginPath();
    pen.rect(plot.left, plot.top, plot.right - plot.left, plot.bottom - plot.top);
    pen.clip();
    this.drawTolerance(pen, plot, y);
    for (const run of this.runs()) this.drawRun(pen, run, x, y);
    pen.restore();
    this.drawStrip(pen, plot, x);
    this.drawReadout(pen, plot, x, y);
    canvas.setAttribute("aria-label", `Offset of ${this.pair} over the last ${this.spanS / 60} minutes; now ${this.lastText()}`);
  }

  lastText() {
    const last = this.rows[this.rows.length - 1];
    return last ? `${offset(last[OFFSET], last[SIGMA])}, ${STATES[last[STATE]]}` : "nothing known";
  }

  /** Limits and step of the axis, from what was measured and what is tolerated. */
  range() {
    const tolerance = this.tolerance() ?? LEAST_MS;
    let low = -1.5 * tolerance, high = 1.5 * tolerance;
    for (const row of this.rows) {
      if (row[OFFSET] === null) continue;
      const band = Math.min(BAND_SIGMAS * (row[SIGMA] ?? 0), 3 * tolerance);
      low = Math.min(low, row[OFFSET] - band, row[LOW]);
      high = Math.max(high, row[OFFSET] + band, row[HIGH]);
    }
    const rough = (high - low) / 4;
    const power = 10 ** Math.floor(Math.log10(rough));
    const step = power * [1, 2, 5, 10].find((factor) => factor * power >= rough);
    return { low: Math.floor(low / step) * step, high: Math.ceil(high / step) * step, step };
  }

  /** The shortest of SPANS_S that shows everything there is. */
  span() {
    const age = this.rows.length ? (this.nowMs - this.rows[0][T]) / 1000 : 0;
    return Number(Object.keys(SPANS_S).find((seconds) => seconds >= age)) || this.keptS;
  }

  tolerance() {
    for (let index = this.rows.length - 1; index >= 0; index--) {
      if (this.rows[index][TOLERANCE] !== null) return this.rows[index][TOLERANCE];
    }
    return null;
  }

  /** Rows that follow one another without a gap and have an offset. */
  runs() {
    const runs = [];
    let run = [];
    for (const row of this.rows) {
      const broken = row[OFFSET] === null || (run.length && row[T] - run[run.length - 1][T] > GAP_MS);
      if (broken && run.length) runs.push(run);
      if (broken) run = [];
      if (row[OFFSET] !== null) run.push(row);
    }
    if (run.length) runs.push(run);
    return runs;
  }

  drawGrid(pen, plot, range, x, y) {
    pen.font = this.font;
    pen.lineWidth = 1;
    pen.textBaseline = "middle";
    pen.textAlign = "right";
    const digits = Math.max(0, -Math.floor(Math.log10(range.step)));
    for (let value = range.low; value <= range.high + range.step / 2; value += range.step) {
      const at = Math.round(y(value)) + 0.5;
      pen.strokeStyle = this.colour(Math.abs(value) < range.step / 2 ? "axis" : "line");
      line(pen, plot.left, at, plot.right, at);
      pen.fillStyle = this.colour("muted");
      const top = value + range.step > range.high + range.step / 2;
      pen.fillText(value.toFixed(digits).replace("-", "−").replace(/^−0(\.0*)?$/, "0") + (top ? " ms" : ""), plot.left - 7, at);
    }
    pen.textBaseline = "top";
    const every = SPANS_S[this.spanS] ?? 60;
    for (let ago = 0; ago <= this.spanS; ago += every) {
      const at = Math.round(x(this.nowMs - ago * 1000)) + 0.5;
      pen.strokeStyle = this.colour("line");
      line(pen, at, plot.top, at, plot.bottom + STRIP);
      pen.textAlign = ago === 0 ? "right" : "center";
      const text = every < 60 ? `−${ago} s` : `−${ago / 60} min`;
      pen.fillText(ago === 0 ? "now" : text, at, plot.bottom + STRIP + 6);
    }
  }

  drawTolerance(pen, plot, y) {
    const tolerance = this.tolerance();
    if (tolerance === null) return;
    pen.fillStyle = this.colour("good-band");
    pen.fillRect(plot.left, y(tolerance), plot.right - plot.left, y(-tolerance) - y(tolerance));
  }

  drawRun(pen, run, x, y) {
    pen.fillStyle = this.colour("band");
    pen.beginPath();
    const edge = (row, sign) => [x(row[T]), y(row[OFFSET] + sign * BAND_SIGMAS * (row[SIGMA] ?? 0))];
    for (const row of run) pen.lineTo(...edge(row, 1));
    for (const row of [...run].reverse()) pen.lineTo(...edge(row, -1));
    pen.fill();
    pen.strokeStyle = this.colour("band-edge");
    pen.lineWidth = 1;
    for (const row of run) if (row[HIGH] > row[LOW]) line(pen, x(row[T]), y(row[LOW]), x(row[T]), y(row[HIGH]));
    pen.lineWidth = 2;
    pen.lineJoin = pen.lineCap = "round";
    let before = run[0];
    for (const row of run) {
      pen.strokeStyle = this.colour(row[STATE] === "s" ? "ink" : `state-${row[STATE]}`);
      line(pen, x(before[T]), y(before[OFFSET]), x(row[T]), y(row[OFFSET]));
      before = row;
    }
  }

  /** The state: a thin line in sync, dots where it cannot be told, a full bar out of sync. */
  drawStrip(pen, plot, x) {
    const top = plot.bottom + 3, height = STRIP - 4;
    for (let index = 0, end; index < this.rows.length; index = end) {
      const state = this.rows[index][STATE];
      const follows = (row, next) => next && next[STATE] === state && next[T] - row[T] <= GAP_MS;
      for (end = index + 1; follows(this.rows[end - 1], this.rows[end]); ) end += 1;
      const next = this.rows[end], last = this.rows[end - 1][T];
      const until = next && next[T] - last <= GAP_MS ? next[T] : last + STEP_MS;
      const from = Math.max(x(this.rows[index][T]), plot.left), to = Math.min(x(until), plot.right);
      pen.fillStyle = this.colour(`state-${state}`);
      if (state === "a") pen.fillRect(from, top, to - from, height);
      if (state === "s") pen.fillRect(from, top + height - 4, to - from, 4);
      if (state === "u") for (let at = from; at < to; at += 6) pen.fillRect(at, top + height - 7, Math.min(3, to - at), 7);
    }
  }

  drawReadout(pen, plot, x, y) {
    const row = this.pointer === null ? null : this.nearest(plot, x);
    this.readout.textContent = row
      ? `${duration((this.nowMs - row[T]) / 1000)} ago: ${offset(row[OFFSET], row[SIGMA])}, ${STATES[row[STATE]]}`
      : LEGEND;
    if (!row) return;
    pen.strokeStyle = this.colour("axis");
    pen.lineWidth = 1;
    line(pen, x(row[T]), plot.top, x(row[T]), plot.bottom + STRIP);
    if (row[OFFSET] === null) return;
    pen.fillStyle = this.colour("ink");
    pen.beginPath();
    pen.arc(x(row[T]), y(row[OFFSET]), 4, 0, 7);
    pen.fill();
  }

  nearest(plot, x) {
    const distance = (row) => Math.abs(x(row[T]) - this.pointer);
    const best = this.rows.reduce((a, b) => (a && distance(a) <= distance(b) ? a : b), null);
    return best && x(best[T]) >= plot.left && distance(best) < 12 ? best : null;
  }
}

function line(pen, x1, y1, x2, y2) {
  pen.beginPath();
  pen.moveTo(x1, y1);
  pen.lineTo(x2, y2);
  pen.stroke();
}
