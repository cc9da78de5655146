// Turns the figures' data into charts. Without this script the page shows the static pictures instead.
// The page runs it inside a function, together with live.js where there is a model to play with.
const styles = JSON.parse(document.getElementById("chart-styles").textContent);
const BAND_OPACITY = 0.2;
const charts = [];
const css = (name) => getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();
const make = (tag, className, parent) => {
  const node = document.createElement(tag);
  if (className) node.className = className;
  if (parent) parent.append(node);
  return node;
};
const named = ([label, unit]) => (unit ? label + " (" + unit + ")" : label);

// 16-bit codes, little endian, between low and high; the largest code is a gap.
function decode(compressed) {
  if (!compressed || compressed instanceof Float64Array) return compressed || null;
  const bytes = atob(compressed.codes);
  const step = (compressed.high - compressed.low) / 65534;
  const values = new Float64Array(bytes.length / 2);
  for (let i = 0; i < values.length; i++) {
    const code = bytes.charCodeAt(2 * i) | (bytes.charCodeAt(2 * i + 1) << 8);
    values[i] = code === 65535 ? NaN : compressed.low + code * step;
  }
  return values;
}

// A number with about four digits of the visible range.
function shown(value, span) {
  const decimals = Math.min(9, Math.max(0, 3 - Math.floor(Math.log10(span || 1))));
  return value.toFixed(decimals).replace(/^-(?=0\.?0*$)/, "").replace("-", "\u2212");
}

function prepare(series) {
  const { name, style, kind, labels, size } = series;
  const [x, y, low, high] = [series.x, series.y, series.low, series.high].map(decode);
  let sorted = series.sorted !== false;
  for (let i = 1; i < x.length && sorted; i++) sorted = !(x[i] < x[i - 1]);
  return { name, style, kind, labels, size, x, y: y || low, low, high, sorted, visible: true, look: styles[style] };
}

// Panels of one figure; linked ones follow each other along x.
class Group {
  constructor(id, linked) {
    Object.assign(this, { id, linked, busy: false, panels: null });
  }

  others(panel, action) {
    if (!this.linked || this.busy || !this.panels || !this.panels.includes(panel)) return;
    this.busy = true;
    for (const other of this.panels) if (other !== panel) action(other);
    this.busy = false;
  }

  zoomed(panel) {
    this.others(panel, (other) => {
      const { min, max } = panel.plot.scales.x, { x } = other.plot.scales;
      if (x.min !== min || x.max !== max) other.plot.setScale("x", { min, max });
    });
  }

  pointed(panel, at) {
    this.others(panel, ({ plot }) => {
      const left = plot.valToPos(at, "x"), inside = left >= 0 && left <= plot.over.clientWidth;
      plot.setCursor(inside ? { left, top: plot.over.clientHeight / 2 } : { left: -10, top: -10 });
    });
  }
}

class Panel {
  constructor(figure, data, parent) {
    this.figure = figure;
    this.data = data;
    this.series = data.series.map(prepare);
    this.box = make("div", "chart", parent);
    this.box.tabIndex = 0;
    this.box.setAttribute("role", "group");
    const names = this.series.map((series) => series.name).filter(Boolean).join(", ");
    this.box.setAttribute("aria-roledescription", "interactive chart");
    this.box.setAttribute("aria-label",
      [data.title, named(data.y) + " against " + named(data.x), names, "arrow keys read values, + and \u2212 zoom, 0 resets"]
        .filter(Boolean).join(". "));
    if (data.title) make("h3", "", this.box).textContent = data.title;
    this.legend();
    this.plot = this.create();
    this.readout = make("div", "readout", this.box);
    this.readout.setAttribute("aria-live", "polite");
    this.box.addEventListener("keydown", (event) => this.key(event));
  }

  legend() {
    const list = make("div", "legend", this.box);
    const groups = new Map();
    for (const series of this.series) {
      if (!series.name) continue;
      const key = series.name + "\n" + series.style;
      if (!groups.has(key)) groups.set(key, []);
      groups.get(key).push(series);
    }
    this.entries = [...groups.values()].map((group) => {
      const button = make("button", "", list);
      button.type = "button";
      button.setAttribute("aria-pressed", "true");
      button.append(swatch(group));
      make("span", "", button).textContent = group[0].name;
      button.addEventListener("click", () => {
        const visible = !group[0].visible;
        for (const series of group) series.visible = visible;
        button.setAttribute("aria-pressed", String(visible));
        this.plot.redraw();
        this.read();
      });
      return { group, button };
    });
  }

  size() {
    const width = Math.max(200, Math.floor(this.box.clientWidth));
    return { width, height: Math.round(Math.min(560, Math.max(this.data.least || 210, width * this.data.aspect + 30))) };
  }

  create() {
    const [x0, x1, y0, y1] = this.data.limits;
    const { width, height } = this.size();
    const scale = (width - 80) / (x1 - x0);
    const rows = labelRows(this.data.marks, (value) => (value - x0) * scale, width - 80, 1);
    const more = 16 * rows.count / Math.max(60, height - 60 - 16 * rows.count);
    const [logX, logY] = this.data.logarithmic;
    const top = logY ? y1 * (y1 / y0) ** more : y1 + (y1 - y0) * more;
    this.full = { x: [x0, x1], y: [y0, top] };
    const axis = (text, size, log) => ({
      label: text, labelSize: 22, size, stroke: () => css("ink"), font: "12px system-ui, sans-serif",
      labelFont: "12px system-ui, sans-serif", labelGap: 0,
      grid: { stroke: () => css("grid"), width: 1 }, ticks: { stroke: () => css("soft"), width: 1, size: 5 },
      values: (u, ticks) => ticks.map((value) => value == null ? "" : log ? String(+value.toPrecision(3)) : tick(value, ticks)),
      ...(log ? { splits: (u, axis, low, high) => logTicks(low, high, axis ? height / 34 : width / 50), filter: (u, ticks) => ticks } : {}),
    });
    const options = {
      ...this.size(), padding: [8, 20, 0, 0], legend: { show: false },
      scales: {
        x: { time: false, distr: logX ? 3 : 1, range: (u, low, high) => [low, high] },
        y: { auto: false, distr: logY ? 3 : 1, range: (u, low, high) => (low == null || low === high ? this.full.y : [low, high]) },
      },
      axes: [
        axis(named(this.data.x), 30, logX),
        { ...axis(named(this.data.y), (u, labels) => this.data.gutter || 14 + Math.max(20, ...(labels || []).map(textWidth)), logY), space: 34, ...this.places() },
      ],
      series: [{}, { paths: () => null, points: { show: false } }],
      cursor: {
        points: { show: false }, drag: { x: true, y: true, uni: 24, setScale: true },
        bind: { dblclick: () => () => { this.reset(); return null; } },
      },
      hooks: {
        drawClear: [(u) => this.drawRanges(u)],
        draw: [(u) => this.drawSeries(u)],
        setCursor: [() => this.read()],
        setScale: [(u, key) => { if (this.plot) this.look(); if (key === "x") this.figure.zoomed(this); }],
      },
    };
    return new uPlot(options, [[x0, x1], [y0, top]], this.box);
  }

  // Names in place of numbers along y.
  places() {
    const names = this.data.names;
    if (!names) return {};
    return { label: null, labelSize: 0, splits: () => names.map((_, k) => k), filter: (u, ticks) => ticks, values: () => names };
  }

  clipped(u, draw) {
    const { left, top, width, height } = u.bbox;
    u.ctx.save();
    u.ctx.beginPath();
    u.ctx.rect(left, top, width, height);
    u.ctx.clip();
    draw(u.ctx, uPlot.pxRatio);
    u.ctx.restore();
  }

  drawRanges(u) {
    this.clipped(u, (ctx) => {
      ctx.fillStyle = css("range");
      for (const { axis, from, to } of this.data.marks) {
        if (from === to) continue;
        const [a, b] = [u.valToPos(from, axis, true), u.valToPos(to, axis, true)];
        if (axis === "x") ctx.fillRect(Math.min(a, b), u.bbox.top, Math.abs(b - a), u.bbox.height);
        else ctx.fillRect(u.bbox.left, Math.min(a, b), u.bbox.width, Math.abs(b - a));
      }
    });
  }

  drawSeries(u) {
    this.clipped(u, (ctx, ratio) => {
      const visible = this.series.filter((series) => series.visible);
      for (const series of visible) {
        if (series.kind === "band") drawBand(u, ctx, series);
        if (series.kind === "cells") drawCells(u, ctx, series, ratio);
      }
      this.drawMarkLines(u, ctx, ratio);
      // Measured curves lie over those of models, which are wider.
      const isMeasured = (series) => series.kind === "line" && series.style === "measured";
      for (const series of visible.filter((own) => !isMeasured(own)).concat(visible.filter(isMeasured))) {
        if (series.kind === "line") drawLine(u, ctx, series, ratio);
        if (series.kind === "bars") drawBars(u, ctx, series, ratio);
        if (["points", "bars", "labels"].includes(series.kind)) drawMarkers(u, ctx, series, ratio);
      }
      this.drawMarkLabels(u, ctx, ratio);
      drawPointLabels(u, ctx, visible, ratio);
    });
  }

  drawMarkLines(u, ctx, ratio) {
    const { left, top, width, height } = u.bbox;
    ctx.strokeStyle = css("soft");
    ctx.lineWidth = ratio;
    ctx.setLineDash([4 * ratio, 3 * ratio]);
    for (const { axis, from, to } of this.data.marks) {
      if (from !== to) continue;
      const at = u.valToPos(from, axis, true);
      ctx.beginPath();
      if (axis === "x") { ctx.moveTo(at, top); ctx.lineTo(at, top + height); }
      else { ctx.moveTo(left, at); ctx.lineTo(left + width, at); }
      ctx.stroke();
    }
    ctx.setLineDash([]);
  }

  drawMarkLabels(u, ctx, ratio) {
    const { left, top, width } = u.bbox;
    ctx.font = 12 * ratio + "px system-ui, sans-serif";
    ctx.textAlign = "center";
    ctx.lineWidth = 4 * ratio;
    ctx.lineJoin = "round";
    ctx.strokeStyle = css("page");
    ctx.fillStyle = css("ink");
    const write = (label, x, y) => { ctx.strokeText(label, x, y); ctx.fillText(label, x, y); };
    const rows = labelRows(this.data.marks, (value) => u.valToPos(value, "x", true) - left, width, ratio);
    for (const { label, centre, row } of rows.labels) write(label, left + centre, top + (14 + 16 * row) * ratio);
    for (const { axis, from, to, label } of this.data.marks) {
      if (axis === "x" || !label) continue;
      const half = (textWidth(label) / 2 + 4) * ratio;
      write(label, left + width - half, u.valToPos((from + to) / 2, "y", true) - 5 * ratio);
    }
  }

  span(key) {
    const { min, max } = this.plot.scales[key];
    return max - min;
  }

  zoom(factor) {
    const [x, y] = ["x", "y"].map((key, at) => {
      const [to, from] = this.data.logarithmic[at] ? [Math.log, Math.exp] : [Number, Number];
      const [min, max] = [this.plot.scales[key].min, this.plot.scales[key].max].map(to);
      const centre = (min + max) / 2, half = (max - min) / 2 * factor;
      const [low, high] = this.full[key];
      return { min: Math.max(low, from(centre - half)), max: Math.min(high, from(centre + half)) };
    });
    this.setView(x, y);
  }

  reset() {
    this.setView({ min: this.full.x[0], max: this.full.x[1] }, { min: this.full.y[0], max: this.full.y[1] });
  }

  // New values, [x, y] for each series, and limits around them; a view that the reader has zoomed to stays.
  show(values, [x0, x1, y0, y1]) {
    values.forEach(([x, y], at) => Object.assign(this.series[at], { x, y }));
    for (const { group, button } of this.entries) button.hidden = group.every((series) => !series.x.length);
    this.full = { x: [x0, x1], y: [y0, y1] };
    if (this.isZoomed) this.plot.redraw(false); else this.reset();
  }

  // Whether the view is another than the whole.
  look() {
    this.isZoomed = ["x", "y"].some((key) => {
      const { min, max } = this.plot.scales[key], [low, high] = this.full[key];
      return min !== low || max !== high;
    });
  }

  setView(x, y) {
    this.plot.batch(() => { this.plot.setScale("x", x); this.plot.setScale("y", y); });
  }

  key(event) {
    const u = this.plot, step = (event.shiftKey ? 20 : 4);
    const width = u.over.clientWidth, height = u.over.clientHeight;
    let { left, top } = u.cursor;
    if (!(left >= 0 && left <= width)) [left, top] = [width / 2, height / 2];
    const moves = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] };
    if (event.target !== this.box || event.ctrlKey || event.metaKey || event.altKey) return;
    if (moves[event.key]) {
      const [dx, dy] = moves[event.key];
      u.setCursor({ left: Math.min(width - 1, Math.max(0, left + dx)), top: Math.min(height - 1, Math.max(0, top + dy)) });
    } else if (event.key === "+" || event.key === "=") this.zoom(0.5);
    else if (event.key === "-" || event.key === "\u2212") this.zoom(2);
    else if (event.key === "0" || event.key === "Escape") this.reset();
    else return;
    event.preventDefault();
  }

  // The values under the cursor: nearest in x on curves over x, nearest on the screen on loops.
  read() {
    if (!this.plot || !this.readout) return;
    const u = this.plot, { left, top } = u.cursor;
    for (const dot of u.over.querySelectorAll(".dot")) dot.remove();
    if (!(left >= 0 && left <= u.over.clientWidth)) { this.readout.textContent = "\u00a0"; return; }
    const at = u.posToVal(left, "x");
    this.readout.textContent = this.data.x[0] + " " + shown(at, this.span("x")) + unit(this.data.x);
    for (const series of this.series) {
      if (!series.visible) continue;
      if (series.kind === "cells") { this.readCell(series, at, u.posToVal(top, "y")); continue; }
      const i = series.sorted ? nearest(series.x, at) : closest(u, series, left, top >= 0 ? top : u.over.clientHeight / 2);
      if (i < 0 || !Number.isFinite(series.y[i])) continue;
      const px = u.valToPos(series.x[i], "x"), py = u.valToPos(series.y[i], "y");
      if (series.sorted && Math.abs(px - left) > 40) continue;
      this.readout.append(" \u00b7 " + (series.labels ? series.labels[i] : series.name || "") + " ");
      make("b", "", this.readout).textContent = this.value(series, i);
      if (px < 0 || py < 0 || px > u.over.clientWidth || py > u.over.clientHeight || series.kind === "band") continue;
      const dot = make("i", "dot", u.over);
      dot.style.left = px + "px";
      dot.style.top = py + "px";
      dot.style.background = css(series.style);
    }
    this.figure.pointed(this, at);
  }

  readCell(series, x, y) {
    const [width, height] = series.size;
    const i = series.x.findIndex((own, k) => Math.abs(own - x) <= width / 2 && Math.abs(series.y[k] - y) <= height / 2);
    if (i < 0) return;
    this.readout.append(" \u00b7 " + this.data.y[0] + " " + shown(series.y[i], this.span("y")) + unit(this.data.y) + " \u00b7 " + series.name + ": ");
    make("b", "", this.readout).textContent = series.labels[i];
  }

  value(series, i) {
    if (this.data.names) return (this.data.names[series.y[i]] || "") + ", " + shown(series.x[i], this.span("x")) + unit(this.data.x);
    const span = this.span("y"), text = (value) => shown(value, span);
    const where = series.sorted ? "" : " at " + shown(series.x[i], this.span("x")) + unit(this.data.x);
    if (series.kind === "band") return text(series.low[i]) + " to " + text(series.high[i]) + unit(this.data.y);
    const bar = series.kind === "bars" ? " (" + text(series.low[i]) + " to " + text(series.high[i]) + ")" : "";
    return text(series.y[i]) + bar + unit(this.data.y) + where;
  }
}

const ruler = document.createElement("canvas").getContext("2d");
ruler.font = "12px system-ui, sans-serif";
const textWidth = (text) => ruler.measureText(text).width;

// Rows under the upper edge in which the labels of vertical marks fit without touching each other.
function labelRows(marks, position, width, ratio) {
  const ends = [], labels = [];
  for (const { axis, from, to, label } of marks) {
    const at = position((from + to) / 2), half = (textWidth(label) / 2 + 4) * ratio;
    if (axis !== "x" || !label || at < 0 || at > width) continue;
    const centre = Math.max(half, Math.min(at, width - half));
    let row = ends.findIndex((end) => end <= centre - half);
    if (row < 0) row = ends.push(0) - 1;
    ends[row] = centre + half;
    labels.push({ label, centre, row });
  }
  return { labels, count: ends.length };
}

const unit = ([, name]) => (name ? "\u00a0" + name : "");

function tick(value, ticks) {
  const step = ticks.length > 1 ? Math.abs(ticks[1] - ticks[0]) : Math.abs(value) || 1;
  if (Math.abs(value) >= 1e6 || step < 1e-6) return value.toExponential(1).replace(/-/g, "\u2212");
  let decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const scaled = step * 10 ** decimals;
  if (Math.abs(scaled - Math.round(scaled)) > 1e-6) decimals++; // a step of a quarter
  return value.toFixed(decimals).replace("-", "\u2212");
}

// Ticks of a logarithmic axis: some or no multiples of powers of ten, so that they are at most about target.
function logTicks(low, high, target) {
  const places = (factors) => {
    const found = [];
    for (let e = Math.floor(Math.log10(low)); e <= Math.ceil(Math.log10(high)); e++)
      for (const factor of factors) found.push(Number(factor + "e" + e));
    return found.filter((at) => at >= low && at <= high);
  };
  const sets = [[1, 2, 3, 5, 7], [1, 2, 5], [1]].map(places);
  const chosen = sets.find((at) => at.length <= target) || sets[2];
  if (chosen.length > 3 || high >= 10 * low) return chosen;
  const raw = (high - low) / target, power = 10 ** Math.floor(Math.log10(raw)), even = [];
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= raw * 0.999);
  for (let at = Math.ceil(low / step) * step; at <= high; at += step) even.push(at);
  return even;
}

function nearest(x, at) {
  let low = 0, high = x.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (x[middle] < at) low = middle; else high = middle;
  }
  return high < 0 ? -1 : Math.abs(x[low] - at) <= Math.abs(x[high] - at) ? low : high;
}

function closest(u, series, left, top) {
  let best = -1, distance = 60 * 60;
  for (let i = 0; i < series.x.length; i++) {
    const dx = u.valToPos(series.x[i], "x") - left, dy = u.valToPos(series.y[i], "y") - top;
    if (dx * dx + dy * dy < distance) { distance = dx * dx + dy * dy; best = i; }
  }
  return best;
}

function place(u, x, y) {
  return [u.valToPos(x, "x", true), u.valToPos(y, "y", true)];
}

function drawLine(u, ctx, series, ratio) {
  ctx.strokeStyle = css(series.style);
  ctx.lineWidth = series.look.width * ratio;
  ctx.lineJoin = "round";
  ctx.setLineDash(series.look.dash.map((length) => length * ratio));
  ctx.beginPath();
  let broken = true;
  for (let i = 0; i < series.x.length; i++) {
    const finite = Number.isFinite(series.x[i]) && Number.isFinite(series.y[i]);
    if (finite) ctx[broken ? "moveTo" : "lineTo"](...place(u, series.x[i], series.y[i]));
    broken = !finite;
  }
  ctx.stroke();
  ctx.setLineDash([]);
}

function drawBand(u, ctx, series) {
  ctx.fillStyle = css(series.style);
  ctx.globalAlpha = BAND_OPACITY;
  const flush = (run) => {
    if (run.length < 2) return;
    ctx.beginPath();
    for (const i of run) ctx.lineTo(...place(u, series.x[i], series.low[i]));
    for (const i of run.reverse()) ctx.lineTo(...place(u, series.x[i], series.high[i]));
    ctx.fill();
  };
  let run = [];
  for (let i = 0; i < series.x.length; i++) {
    if (Number.isFinite(series.x[i] + series.low[i] + series.high[i])) run.push(i);
    else { flush(run); run = []; }
  }
  flush(run);
  ctx.globalAlpha = 1;
}

// Cells of a map, each with its text where that fits.
function drawCells(u, ctx, series, ratio) {
  const [width, height] = series.size, ink = /[012]$/.test(series.style) ? "#ffffff" : "#1a1a1a";
  ctx.font = 9 * ratio + "px system-ui, sans-serif";
  ctx.textAlign = "center";
  ctx.textBaseline = "middle";
  const widest = ctx.measureText("8.8k").width;  // all labels of a map or none
  for (let i = 0; i < series.x.length; i++) {
    const [left, bottom] = place(u, series.x[i] - width / 2, series.y[i] - height / 2);
    const [right, top] = place(u, series.x[i] + width / 2, series.y[i] + height / 2);
    ctx.fillStyle = css(series.style);
    ctx.fillRect(left, top, right - left + 0.5, bottom - top + 0.5);
    if (widest > right - left - ratio || bottom - top < 10 * ratio) continue;
    ctx.fillStyle = ink;
    ctx.fillText(series.labels[i], (left + right) / 2, (top + bottom) / 2);
  }
  ctx.textBaseline = "alphabetic";
}

function drawBars(u, ctx, series, ratio) {
  ctx.strokeStyle = css(series.style);
  ctx.lineWidth = 1.2 * ratio;
  ctx.beginPath();
  for (let i = 0; i < series.x.length; i++) {
    if (!Number.isFinite(series.low[i] + series.high[i])) continue;
    const [x, low] = place(u, series.x[i], series.low[i]), [, high] = place(u, series.x[i], series.high[i]);
    ctx.moveTo(x, low); ctx.lineTo(x, high);
    for (const y of [low, high]) { ctx.moveTo(x - 3 * ratio, y); ctx.lineTo(x + 3 * ratio, y); }
  }
  ctx.stroke();
}

function drawMarkers(u, ctx, series, ratio) {
  const radius = (series.kind === "labels" ? 4 : series.x.length <= 80 ? 3 : series.x.length <= 400 ? 2.2 : 1.5) * ratio;
  ctx.fillStyle = css(series.style);
  ctx.beginPath();
  for (let i = 0; i < series.x.length; i++) {
    if (!Number.isFinite(series.x[i] + series.y[i])) continue;
    const [x, y] = place(u, series.x[i], series.y[i]);
    outline(ctx, series.look.marker, x, y, radius);
  }
  ctx.fill();
}

// Texts beside points, each where it covers no other text, no marker and as little of a line as possible.
function drawPointLabels(u, ctx, all, ratio) {
  const { left, top, width, height } = u.bbox, texts = [], markers = [], lines = [];
  const box = (x, y, w, h) => ({ x, y, w, h });
  const near = (a) => box(a.x, a.y, a.w + 5 * ratio, a.h + 5 * ratio);
  const hits = (a, others) => others.filter((b) => Math.abs(a.x - b.x) < a.w + b.w && Math.abs(a.y - b.y) < a.h + b.h).length;
  for (const series of all.filter((one) => one.kind !== "band" && one.kind !== "cells")) {
    const at = Array.from(series.x, (x, i) => place(u, x, series.y[i]));
    if (series.kind !== "line") markers.push(...at.map(([x, y]) => box(x, y, 4 * ratio, 4 * ratio)));
    else for (let i = 1; i < at.length; i++) for (let k = 0; k <= 20; k++)
      lines.push(box(at[i - 1][0] + (at[i][0] - at[i - 1][0]) * k / 20, at[i - 1][1] + (at[i][1] - at[i - 1][1]) * k / 20, 1, 1));
  }
  ctx.font = 12 * ratio + "px system-ui, sans-serif";
  ctx.textAlign = "center";
  ctx.textBaseline = "middle";
  ctx.lineWidth = 4 * ratio;
  ctx.lineJoin = "round";
  ctx.strokeStyle = css("page");
  for (const series of all.filter((one) => one.kind === "labels")) for (let i = 0; i < series.x.length; i++) {
    const [px, py] = place(u, series.x[i], series.y[i]);
    if (px < left || px > left + width || py < top || py > top + height) continue;
    const w = textWidth(series.labels[i]) / 2 * ratio, h = 7 * ratio;
    let best, least = Infinity;
    for (const ring of [8, 17, 26]) for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1], [.9, .9], [.9, -.9], [-.9, .9], [-.9, -.9]]) {
      const a = box(px + dx * (w + ring * ratio), py + dy * (h + ring * ratio), w, h);
      const outside = a.x - w < left || a.x + w > left + width || a.y - h < top || a.y + h > top + height;
      const cost = (outside ? 1000 : 0) + 100 * hits(a, texts) + 20 * hits(a, markers) + 4 * hits(near(a), markers) + hits(a, lines);
      if (cost < least) { least = cost; best = a; }
    }
    texts.push(best);
    ctx.fillStyle = css(series.style);
    ctx.strokeText(series.labels[i], best.x, best.y);
    ctx.fillText(series.labels[i], best.x, best.y);
  }
  ctx.textBaseline = "alphabetic";
}

function outline(ctx, marker, x, y, r) {
  const corners = {
    square: [[-.9, -.9], [.9, -.9], [.9, .9], [-.9, .9]],
    triangle: [[0, -1.3], [1.2, .9], [-1.2, .9]],
    diamond: [[0, -1.4], [1.2, 0], [0, 1.4], [-1.2, 0]],
  }[marker];
  if (!corners) { ctx.moveTo(x + r, y); ctx.arc(x, y, r, 0, 7); return; }
  corners.forEach(([dx, dy], at) => ctx[at ? "lineTo" : "moveTo"](x + dx * r, y + dy * r));
  ctx.closePath();
}

function swatch(group) {
  const space = "http://www.w3.org/2000/svg";
  const node = (tag, attributes, parent) => {
    const element = document.createElementNS(space, tag);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    parent.append(element);
    return element;
  };
  const { style, look } = group[0], colour = "var(--" + style + ")";
  const svg = node("svg", { width: 24, height: 12, viewBox: "0 0 24 12", "aria-hidden": "true" }, document.createDocumentFragment());
  for (const { kind } of group) {
    if (kind === "cells") node("rect", { x: 0, y: 1, width: 24, height: 10, fill: colour }, svg);
    if (kind === "band") node("rect", { x: 0, y: 1, width: 24, height: 10, fill: colour, "fill-opacity": 0.3 }, svg);
    if (kind === "line") node("line", { x1: 0, y1: 6, x2: 24, y2: 6, stroke: colour, "stroke-width": look.width + 0.4, "stroke-dasharray": look.dash.join(" ") }, svg);
    if (kind === "points" || kind === "bars" || kind === "labels") {
      const shape = { square: "M9 3h6v6H9z", triangle: "M12 2l4 7H8z", diamond: "M12 2l3.5 4-3.5 4-3.5-4z" }[look.marker];
      node("path", { d: shape || "M9 6a3 3 0 1 0 6 0a3 3 0 1 0-6 0", fill: colour }, svg);
    }
  }
  return svg;
}

class Figure extends Group {
  constructor(element) {
    const data = JSON.parse(element.querySelector('script[type="application/json"]').textContent);
    super(data.id, data.linked);
    this.element = element;
    const area = make("div", "charts" + (data.columns > 1 ? " beside" : ""));
    const caption = element.querySelector("figcaption");
    element.insertBefore(area, caption);
    element.classList.add("with-charts");
    this.panels = data.panels.map((panel) => new Panel(this, panel, area));
    this.tools(caption);
    new ResizeObserver(() => this.panels.forEach((panel) => panel.plot.setSize(panel.size()))).observe(area);
  }

  tools(caption) {
    const bar = make("div", "tools");
    this.element.insertBefore(bar, caption);
    const button = (text, label, action) => {
      const node = make("button", "", bar);
      node.type = "button";
      node.textContent = text;
      node.setAttribute("aria-label", label);
      node.addEventListener("click", action);
    };
    const all = (action) => () => this.panels.forEach(action);
    button("Zoom in", "Zoom in, figure " + this.id, all((panel) => panel.zoom(0.5)));
    button("Zoom out", "Zoom out, figure " + this.id, all((panel) => panel.zoom(2)));
    button("Reset", "Reset zoom, figure " + this.id, all((panel) => panel.reset()));
    button("SVG", "Download figure " + this.id + " as SVG", () => this.saveSvg());
    button("PNG", "Download figure " + this.id + " as PNG", () => this.savePng());
  }

  svgText() {
    const svg = this.element.querySelector(".static svg").cloneNode(true);
    const { width, height } = this.element.querySelector(".static svg").viewBox.baseVal;
    svg.setAttribute("width", width / 4 + "mm");
    svg.setAttribute("height", height / 4 + "mm");
    return new XMLSerializer().serializeToString(svg);
  }

  saveSvg() {
    save(new Blob([this.svgText()], { type: "image/svg+xml" }), this.id + ".svg");
  }

  savePng() {
    const { width, height } = this.element.querySelector(".static svg").viewBox.baseVal;
    const image = new Image();
    image.onload = () => {
      const canvas = document.createElement("canvas");
      canvas.width = Math.ceil(2.5 * width);
      canvas.height = Math.ceil(2.5 * height);
      canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
      canvas.toBlob((blob) => save(blob, this.id + ".png"), "image/png");
    };
    image.src = "data:image/svg+xml;charset=utf-8," + encodeURIComponent(this.svgText());
  }
}

function save(blob, name) {
  const link = make("a", "");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

for (const element of document.querySelectorAll("figure")) charts.push(new Figure(element));
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  for (const figure of charts) for (const panel of figure.panels) panel.plot.redraw(false, true);
});
