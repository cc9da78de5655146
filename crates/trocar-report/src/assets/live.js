
// The live model of the report: parameters to turn, a motion to replay, to drag or to draw.

const SHOWN_DRAG = 10, LONGEST_DRAWING = 10;  // s

// The parameters: a slider and a field each.
class Knobs {
  constructor(data, parent, changed) {
    this.data = data;
    this.values = data.map((knob) => knob.value);
    this.changed = changed;
    this.alike = data.some((knob) => knob.follows !== null);
    this.rows = new Map();
    const bar = make("div", "knob-bar", parent);
    make("h3", "", bar).textContent = "Parameters";
    this.resetAll = button(bar, "Reset all", "Reset all parameters", () => this.reset());
    if (this.alike) this.check(parent);
    const shown = data.map((_, at) => at).filter((at) => data[at].range);
    for (const at of shown.filter((at) => data[at].main)) this.row(at, parent);
    const rest = shown.filter((at) => !data[at].main);
    if (rest.length) {
      const more = make("details", "", parent);
      make("summary", "", more).textContent = "More parameters";
      for (const at of rest) this.row(at, more);
    }
    this.message = make("p", "knob-message", parent);
    this.message.setAttribute("role", "status");
    this.refresh();
  }

  check(parent) {
    const label = make("label", "knob-alike", parent), box = make("input", "", label);
    box.type = "checkbox";
    box.checked = true;
    label.append(" Both directions alike");
    box.addEventListener("change", () => {
      this.alike = box.checked;
      if (this.alike) this.data.forEach((knob, at) => { if (knob.follows !== null) this.values[at] = this.values[knob.follows]; });
      this.refresh();
      this.changed();
    });
  }

  row(at, parent) {
    const knob = this.data[at], row = make("div", "knob", parent), [low, high] = knob.range;
    const name = make("label", "", row), field = make("input", "", row);
    make("span", "unit", row).textContent = knob.unit;
    const track = make("div", "track", row), slider = make("input", "", track);
    const reset = button(row, "\u21ba", "Reset " + knob.name, () => this.set(at, knob.value));
    const part = (value) => clamp((value - low) / (high - low), 0, 1);
    if (knob.interval) {
      const mark = make("span", "interval", track), [from, to] = knob.interval.map(part);
      mark.title = "95 % interval";
      mark.style.setProperty("--from", from);
      mark.style.setProperty("--to", to);
    }
    make("span", "found", track).style.setProperty("--from", part(knob.value));
    Object.assign(slider, { type: "range", min: 0, max: 1000, step: 1, id: "knob-" + at });
    Object.assign(field, { type: "number", step: "any" });
    name.htmlFor = slider.id;
    slider.addEventListener("input", () => this.set(at, low + (high - low) * slider.value / 1000, slider));
    field.addEventListener("change", () => {
      const value = field.valueAsNumber / knob.scale;
      if (Number.isFinite(value)) this.set(at, value); else this.refresh();
    });
    this.rows.set(at, { row, name, field, slider, reset, part });
  }

  set(at, value, by) {
    this.values[at] = value;
    if (this.alike) this.data.forEach((knob, other) => { if (knob.follows === at) this.values[other] = value; });
    this.refresh(by);
    this.changed();
  }

  reset() {
    this.values = this.data.map((knob) => knob.value);
    this.refresh();
    this.changed();
  }

  get turned() {
    return this.values.some((value, at) => value !== this.data[at].value);
  }

  // What the fields and sliders say; the one in use stays as it is.
  refresh(by) {
    for (const [at, { row, name, field, slider, reset, part }] of this.rows) {
      const knob = this.data[at], value = this.values[at], shownValue = precise(knob.scale * value);
      const plain = (text) => (this.alike ? text.replace(", insertion", "").replace("\u207a", "") : text);
      const text = plain(knob.name);
      row.hidden = this.alike && knob.follows !== null;
      name.replaceChildren(text + " ");
      typeset(make("i", "", name), plain(knob.symbol));
      field.setAttribute("aria-label", text + (knob.unit ? ", " + knob.unit : ""));
      field.value = shownValue.replace("\u2212", "-");
      row.dataset.value = value;
      if (slider !== by) slider.value = Math.round(1000 * part(value));
      slider.setAttribute("aria-valuetext", shownValue + " " + knob.unit);
      reset.disabled = value === knob.value;
    }
    this.resetAll.disabled = !this.turned;
  }

  say(works) {
    this.message.textContent = works ? "" : "These values make no model; the last one that works is shown.";
  }
}

// The pen over the chart of positions: every millisecond has a place, drawn or not.
class Pen {
  constructor(panel, way, changed) {
    Object.assign(this, { panel, way, changed, drawn: new Float64Array(LONGEST_DRAWING / MILLISECOND + 1).fill(NaN), at: null });
    this.box = make("div", "pen", panel.plot.over);
    Object.assign(this.box, { tabIndex: 0, hidden: true });
    this.box.setAttribute("role", "application");
    this.box.setAttribute("aria-label", "Drawing area: position over time. Arrow right draws on, up and down move the pen, left goes back");
    this.hint = make("span", "", this.box);
    this.hint.textContent = "draw a motion here, from left to right";
    this.box.addEventListener("pointerdown", (event) => this.down(event));
    this.box.addEventListener("pointermove", (event) => this.move(event));
    for (const end of ["pointerup", "pointercancel"]) this.box.addEventListener(end, () => { this.isDown = false; });
    this.box.addEventListener("keydown", (event) => this.key(event));
    for (const name of ["mousedown", "dblclick"]) this.box.addEventListener(name, (event) => event.stopPropagation());
  }

  place(event) {
    const { left, top } = this.box.getBoundingClientRect(), { plot } = this.panel;
    const time = plot.posToVal(event.clientX - left, "x"), position = plot.posToVal(event.clientY - top, "y") / MM;
    return this.within(time / MILLISECOND, position);
  }

  within(sample, position) {
    return { sample: clamp(Math.round(sample), 0, this.drawn.length - 1), position: clamp(position, ...this.way) };
  }

  down(event) {
    if (event.button !== 0) return;
    this.box.setPointerCapture(event.pointerId);
    this.box.focus({ preventScroll: true });
    this.isDown = true;
    this.at = this.place(event);
    this.line(this.at);
    event.preventDefault();
  }

  move(event) {
    if (!this.isDown) return;
    const all = event.getCoalescedEvents ? event.getCoalescedEvents() : [];
    for (const one of all.length ? all : [event]) this.line(this.place(one));
  }

  // From the last place to the next, over what was there.
  line(next) {
    const last = this.at || next, count = Math.abs(next.sample - last.sample);
    for (let i = 0; i <= count; i++) {
      const part = count ? i / count : 1;
      this.drawn[last.sample + Math.sign(next.sample - last.sample) * i] = last.position + part * (next.position - last.position);
    }
    this.at = next;
    this.changed();
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const [ahead, up] = { ArrowRight: [50, 0], ArrowUp: [25, 1], ArrowDown: [25, -1], ArrowLeft: [-50, 0] }[event.key] || [];
    if (ahead === undefined) return;
    const from = this.at || this.within(0, (this.way[0] + this.way[1]) / 2);
    this.at = from;
    const next = this.within(from.sample + ahead, from.position + up * KEY_STEP * (event.shiftKey ? 5 : 1));
    if (ahead < 0) this.at = { sample: next.sample, position: Number.isFinite(this.drawn[next.sample]) ? this.drawn[next.sample] : next.position };
    else this.line(next);
    event.preventDefault();
    event.stopPropagation();
  }

  clear() {
    this.drawn.fill(NaN);
    this.at = null;
    this.changed();
  }

  // Times and positions from the first place drawn to the last, straight over what was left out; null before two places.
  motion() {
    const known = [];
    this.drawn.forEach((position, at) => { if (Number.isFinite(position)) known.push(at); });
    this.hint.hidden = known.length > 0;
    if (known.length < 2) return null;
    const times = [], positions = [];
    for (let k = 1; k < known.length; k++) for (let at = known[k - 1]; at < known[k]; at++) {
      const part = (at - known[k - 1]) / (known[k] - known[k - 1]);
      times.push(at / 1000);
      positions.push(this.drawn[known[k - 1]] + part * (this.drawn[known[k]] - this.drawn[known[k - 1]]));
    }
    times.push(known.at(-1) / 1000);
    positions.push(this.drawn[known.at(-1)]);
    return [times, positions];
  }
}

// What is measured: a recorded excerpt.
function excerptOf(compressed) {
  if (!compressed) return null;
  const [position, force] = [compressed.position, compressed.force].map(decode), angle = compressed.angle && decode(compressed.angle);
  const time = Float64Array.from(position, (_, i) => i * compressed.interval);
  return { ...compressed, time, position, force, angle, shown: position.map((metres) => MM * metres) };
}

const MODES = { recorded: "Recorded motion", drag: "Drag the instrument", draw: "Draw a motion" };
const HINTS = {
  drag: "Drag the handle under the loop, or focus it and use the arrow keys. Time runs while you hold it; the purple bar is the seal, " +
    "deformed from where it grips.",
  draw: "Draw position over time in the upper chart with pointer or finger; draw over what you would change. The seal starts undeformed.",
};

class Live {
  constructor(element, data, runner) {
    this.data = data;
    this.runner = runner;
    this.excerpt = excerptOf(data.excerpt);
    this.hand = new Hand(this, data.way);
    this.element = element;
    this.modes();
    const body = make("div", "live-body", element);
    this.knobs = new Knobs(data.knobs, make("div", "knobs", body), () => this.tuned());
    const view = make("div", "live-view", body);
    this.status(view);
    this.hint = make("p", "live-hint", view);
    this.panels(make("div", "charts", view));
    this.tools(view);
    this.setMode(this.excerpt ? "recorded" : "drag");
    new ResizeObserver(() => { this.all.forEach((panel) => panel.plot.setSize(panel.size())); this.draw(); }).observe(view);
  }

  modes() {
    const group = make("div", "live-modes", this.element);
    group.setAttribute("role", "radiogroup");
    group.setAttribute("aria-label", "Motion");
    this.radios = {};
    for (const [mode, words] of Object.entries(MODES)) {
      if (mode === "recorded" && !this.excerpt) continue;
      const label = make("label", "", group), radio = make("input", "", label);
      Object.assign(radio, { type: "radio", name: "live-mode", value: mode });
      make("span", "", label).textContent = words;
      radio.addEventListener("change", () => this.setMode(mode));
      this.radios[mode] = radio;
    }
  }

  status(parent) {
    const list = make("dl", "live-status", parent);
    const entry = (name, words) => {
      const box = make("div", "", list);
      make("dt", "", box).textContent = words;
      const value = make("dd", "", box);
      value.dataset.live = name;
      return value;
    };
    this.said = { force: entry("force", "Force"), torque: entry("torque", "Torque"), deflection: entry("deflection", "Deflection of the seal"), sliding: entry("sliding", "Seal"),
      error: entry("error", "Error (rms)") };
  }

  panels(area) {
    const line = (name, style, sorted) => ({ name, style, kind: "line", sorted, x: new Float64Array(0), y: new Float64Array(0) });
    const dot = (sorted) => ({ name: "", style: "fit", kind: "points", sorted, x: new Float64Array(0), y: new Float64Array(0) });
    const forces = (sorted) => [line("measured", "measured", sorted), line("model as identified", "lower", sorted), line("model", "model", sorted), dot(sorted)];
    const data = (x, y, series, aspect, least) =>
      ({ title: "", x, y, limits: [0, 1, 0, 1], logarithmic: [false, false], aspect, least, gutter: 46, series, marks: [] });
    const [time, position, force] = [["time", "s"], ["position", "mm"], ["force", "N"]];
    const linked = new Group("live", true);
    this.path = new Panel(linked, data(time, position, [line("", "measured", true), dot(true)], 0.18, 140), area);
    this.force = new Panel(linked, data(time, force, forces(true), 0.3, 190), area);
    linked.panels = [this.path, this.force];
    this.loop = new Panel(new Group("live-loop", false), data(position, force, forces(false), 0.36, 220), area);
    this.all = [this.path, this.force, this.loop];
    this.round = this.data.turning && new Round(this, area, data, [line, dot]);
    if (this.round) this.all.push(this.round.panel);
    this.loop.box.classList.add("with-strip");
    this.pen = new Pen(this.path, this.data.way, () => this.schedule());
    this.strip = new Strip(this.loop, this.data.way, this.dragging(), "Position of the instrument, mm");
  }

  tools(parent) {
    const bar = make("div", "tools", parent);
    this.player = button(bar, "Play", "Play the recorded motion", () => (this.playing ? this.stop() : this.play()));
    this.anew = button(bar, "Start anew", "Start anew, undeformed", () => this.restart());
    button(bar, "CSV", "Download motion and force as CSV", () =>
      save(new Blob([this.motion.csv()], { type: "text/csv" }), "motion.csv"));
  }

  setMode(mode) {
    this.stop();
    this.mode = mode;
    this.element.dataset.mode = mode;
    this.radios[mode].checked = true;
    this.pen.box.hidden = mode !== "draw";
    this.player.hidden = mode !== "recorded" || reducedMotion();
    this.anew.hidden = mode === "recorded";
    this.path.data.least = mode === "draw" ? 260 : 140;
    this.path.plot.setSize(this.path.size());
    this.hint.textContent = mode === "recorded" ? this.excerpt.name : HINTS[mode] + (mode === "drag" && this.round ? TURN_HINT : "");
    this.restart();
  }

  restart() {
    this.motion = null;
    this.hand.rest(this.strip.position);
    if (this.round) this.round.back();
    if (this.mode === "draw") this.pen.clear();
    this.tuned();
  }

  // The same motion with the present parameters.
  tuned() {
    const works = this.runner.tune(this.knobs.values);
    this.knobs.say(works);
    if (works) this.working = this.knobs.values.slice();
    this.compute();
    this.draw();
  }

  // Times, positions and, where it is known, the force at the start.
  source() {
    if (this.mode === "recorded") return [this.excerpt.time, this.excerpt.position, this.excerpt.force[0], this.excerpt.angle];
    if (this.mode === "drag" && this.motion) return [this.motion.time, this.motion.position, undefined, this.motion.angle];
    return (this.mode === "draw" && this.pen.motion()) || [[0], [this.strip.position]];
  }

  compute() {
    const { runner, working, data } = this, source = this.source(), found = data.knobs.map((knob) => knob.value);
    this.identified = null;
    if (working.some((value, at) => value !== found[at])) {
      runner.tune(found);
      this.identified = Motion.along(runner, ...source);
      runner.tune(working);
    }
    this.motion = Motion.along(runner, ...source);
    this.now = this.motion.end;
  }

  schedule() {
    if (this.isScheduled) return;
    this.isScheduled = true;
    requestAnimationFrame(() => { this.isScheduled = false; this.compute(); this.draw(); });
  }

  // Root mean square of measured minus computed, once the start is forgotten.
  error(motion) {
    let squares = 0, count = 0;
    for (let i = this.excerpt.known; i < this.excerpt.force.length; i++, count++) squares += (this.excerpt.force[i] - motion.force[i]) ** 2;
    return Math.sqrt(squares / count);
  }

  draw() {
    if (!this.motion) return;
    const { motion, excerpt } = this, recorded = this.mode === "recorded", drag = this.mode === "drag";
    const now = recorded ? this.now : motion.end, end = motion.time.at(-1);
    const from = !drag ? 0 : reducedMotion() ? SHOWN_DRAG * Math.floor(end / SHOWN_DRAG) : Math.max(0, end - SHOWN_DRAG);
    const until = recorded ? excerpt.time.at(-1) : drag ? from + SHOWN_DRAG : LONGEST_DRAWING;
    const none = [new Float64Array(0), new Float64Array(0)], point = (x, y) => [Float64Array.of(x), Float64Array.of(y)];
    const [time, position, force] = motion.columns(from, "time", "position", "force");
    const identified = this.identified ? this.identified.columns(from, "time", "position", "force") : null;
    const way = this.data.way.map((metres) => MM * metres), margin = 0.03 * (way[1] - way[0]);
    const along = [way[0] - margin, way[1] + margin], high = this.range(force);
    const dotAt = [motion.time[now], MM * motion.position[now], motion.force[now]];
    const isEmpty = motion.time.length < 2;
    const shown = (values) => (isEmpty && !drag ? none : values);
    this.path.show([shown([time, position]), shown(point(dotAt[0], dotAt[1]))], [from, until, ...along]);
    this.force.data.marks = recorded && excerpt.known > 0 ? [{ axis: "x", from: 0, to: excerpt.time[excerpt.known], label: "start unknown" }] : [];
    this.force.show([recorded ? [excerpt.time, excerpt.force] : none, identified ? [identified[0], identified[2]] : none, shown([time, force]),
      shown(point(dotAt[0], dotAt[2]))], [from, until, ...high]);
    this.loop.show([excerpt ? [excerpt.shown, excerpt.force] : none, identified ? [identified[1], identified[2]] : none, shown([position, force]),
      shown(point(dotAt[1], dotAt[2]))], [...along, ...high]);
    if (this.round) this.round.draw(motion, from, now);
    this.say(now);
    this.strip.show(motion.position[now], motion.deflection[now], (MM * motion.position[now]).toFixed(1) + " mm, " + motion.force[now].toFixed(2) + " N");
  }

  // Forces that fit all that is drawn, rounded outwards, so that the axis rests while a slider moves a little.
  range(force) {
    let low = 0, high = 0;
    for (const values of [force, this.excerpt ? this.excerpt.force : []]) for (const value of values) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
    const step = 10 ** Math.floor(Math.log10(Math.max(high - low, 0.1))) / 2;
    return [step * Math.floor((low - 0.1 * step) / step), step * Math.ceil((high + 0.1 * step) / step)];
  }

  say(now) {
    const { motion, said } = this, put = (node, text, value) => { node.textContent = text; node.dataset.value = value; };
    const signed = (value, decimals) => value.toFixed(decimals).replace(/^-(?=0\.?0*$)/, "").replace("-", "\u2212");
    said.force.previousSibling.textContent = this.mode === "drag" ? "Force now" : "Force at " + motion.time[now].toFixed(2) + " s";
    put(said.force, signed(motion.force[now], 2) + " N", motion.force[now]);
    said.torque.parentNode.hidden = !this.data.turning;
    put(said.torque, signed(1e3 * motion.torque[now], 1) + " mN\u00a0m", motion.torque[now]);
    const deflection = motion.deflection[now], knows = Number.isFinite(deflection);
    said.deflection.parentNode.hidden = said.sliding.parentNode.hidden = !knows;
    put(said.deflection, signed(MM * deflection, 2) + " mm", deflection);
    put(said.sliding, motion.sliding[now] ? "slides" : "deforms", motion.sliding[now]);
    said.error.parentNode.hidden = this.mode !== "recorded";
    if (this.mode !== "recorded") return;
    const error = this.error(motion);
    put(said.error, precise(Number(error.toPrecision(3))) + " N", error);
    if (this.identified) make("small", "", said.error).textContent = "as identified " + Number(this.error(this.identified).toPrecision(3)) + " N";
  }

  play() {
    this.playing = true;
    this.player.textContent = "Stop";
    const { time } = this.motion, begun = performance.now() - 1000 * (this.now < this.motion.end ? time[this.now] : 0);
    const frame = () => {
      if (!this.playing) return;
      const at = (performance.now() - begun) / 1000;
      if (at >= time.at(-1)) { this.stop(); return; }
      this.now = nearest(time, at);
      this.draw();
      requestAnimationFrame(frame);
    };
    frame();
  }

  stop() {
    if (!this.playing) return;
    this.playing = false;
    this.player.textContent = "Play";
    this.now = this.motion.end;
    this.draw();
  }

  // A drag begins in whatever mode, with the hand where the instrument is.
  dragging() {
    const begin = () => { if (this.mode !== "drag") this.setMode("drag"); this.identified = null; };
    return {
      hold: () => { begin(); this.hand.hold(); },
      move: (position) => this.hand.move(position),
      release: () => this.hand.release(),
      key: (step) => { begin(); this.hand.key(step); },
    };
  }

  get isMoved() {
    return this.mode === "drag";
  }

  moved() {
    this.draw();
  }

  rested() {
    this.compute();
    this.draw();
  }
}

async function goLive(element) {
  const [json, module] = element.querySelectorAll("script");
  const data = JSON.parse(json.textContent);
  for (const knob of data.knobs) knob.value ??= Infinity;  // JSON has no infinite number
  const runner = await Runner.start(module.textContent, new Float64Array(bytesOf(data.row).buffer));
  element.querySelector(".live-absent").remove();
  const live = element.live = new Live(element, data, runner);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => live.all.forEach((panel) => panel.plot.redraw(false, true)));
}

goLive(document.getElementById("live")).catch((error) => console.error("live model: " + error.message));
