
// The loop of `trocar teleop`, run in the page: what is compensated, delay, tissue and architecture to turn, the motion of the
// configuration to watch, or the leader's handle to drag. Inside all numbers are in SI.

const LONGEST_COURSE = 60, SHOWN_COURSE = 10, LINGER = 1.5, HAND = 0.03;  // s
const MOST_FORCE = 100, MOST_AWAY = 0.2;  // N, m: what a chart shows of a loop that grows
const DELAY_SHOWN = 0.1, FRACTION_SHOWN = 1.5, STIFFNESS_SHOWN = [10, 10000];  // s, 1, N/m
const COLUMNS = ["hand_position_m", "leader_position_m", "follower_position_m", "felt_force_n", "trocar_force_n", "tissue_force_n", "estimate_n"];
const FIGURES = ["displayed", "true", "error", "steps"];

// The WebAssembly module, crates/trocar-web-teleop: one loop.
class LoopRunner {
  static async start(compressed, models) {
    const plain = new Blob([bytesOf(compressed)]).stream().pipeThrough(new DecompressionStream("gzip"));
    const { instance } = await WebAssembly.instantiate(await new Response(plain).arrayBuffer());
    return new LoopRunner(instance.exports, models);
  }

  constructor(module, models) {
    this.module = module;
    this.counts = models.map((row) => row.length);
    this.length = module.block_length();
    this.numbers("row", this.counts[0] + this.counts[1]).set([...models[0], ...models[1]]);
  }

  // The module's memory may have moved since the last call.
  numbers(name, count) {
    return new Float64Array(this.module.memory.buffer, this.module[name](), count);
  }

  // A loop at rest; why there is none, or nothing.
  begin(config, position) {
    const { module } = this, bytes = new TextEncoder().encode(JSON.stringify(config));
    const text = new Uint8Array(module.memory.buffer, module.text(), module.text_length());
    if (bytes.length > text.length) return "the configuration is too long";
    text.set(bytes);
    if (module.start(bytes.length, ...this.counts, position)) return "";
    return new TextDecoder().decode(new Uint8Array(module.memory.buffer, module.text(), module.message()));
  }

  // Up to a block of samples, over which the hand moves to these positions; copies of the columns.
  run(hands) {
    this.numbers("block", hands.length).set(hands);
    const made = this.module.run(hands.length), columns = this.numbers("block", COLUMNS.length * this.length);
    return COLUMNS.map((_, at) => columns.slice(at * this.length, at * this.length + made));
  }

  // Whether the loop comes to rest after pushes and pulls.
  settles() {
    return this.module.settles() === 1;
  }

  figures() {
    this.module.figures();
    const found = this.numbers("block", FIGURES.length);
    return Object.fromEntries(FIGURES.map((name, at) => [name, found[at]]));
  }
}

// The samples of a loop, with the motion of the hand that made them.
class Course {
  constructor(runner, config, position, seconds) {
    Object.assign(this, { runner, interval: seconds, hand: [position], columns: COLUMNS.map(() => []), diverged: false });
    this.refusal = runner.begin(config, position);
  }

  // The hand moves on to these positions, a sample each.
  append(hands) {
    for (let from = 0; from < hands.length; from += this.runner.length) {
      if (this.refusal || this.diverged) return;
      const some = hands.slice(from, from + this.runner.length), found = this.runner.run(some);
      found.forEach((column, at) => { for (const value of column) this.columns[at].push(value); });
      this.diverged = found[0].length < some.length;
      for (let i = 0; i < found[0].length; i++) this.hand.push(some[i]);
    }
  }

  get count() {
    return this.columns[0].length;
  }

  get end() {
    return this.count * this.interval;
  }

  last(name) {
    return this.columns[COLUMNS.indexOf(name)].at(-1);
  }

  // Times from one on, and columns, as many as show on the screen.
  shown(from, ...names) {
    const first = Math.min(this.count, Math.max(0, Math.ceil(from / this.interval - 1e-9))), count = this.count - first;
    const every = Math.max(1, Math.ceil(count / MOST_DRAWN)), shown = Math.ceil(count / every);
    const at = (i) => (i === shown - 1 ? this.count - 1 : first + i * every);
    const time = Float64Array.from({ length: shown }, (_, i) => at(i) * this.interval);
    return [time, ...names.map((name) => {
      const column = this.columns[COLUMNS.indexOf(name)];
      return Float64Array.from({ length: shown }, (_, i) => column[at(i)]);
    })];
  }

  csv() {
    const rows = Array.from({ length: this.count }, (_, k) => [k * this.interval, ...this.columns.map((column) => column[k])].join());
    return "time_s," + COLUMNS.join() + "\n" + rows.join("\n") + "\n";
  }
}

const ARCHITECTURES = { position_force: "Position\u2013force", position_position: "Position\u2013position", four_channel: "Four-channel", wave: "Wave variables" };

// What the reader turns: a configuration with four of its keys changed.
class Turned {
  constructor(config, parent, changed) {
    this.found = config;
    this.changed = changed;
    this.rows = [];
    const bar = make("div", "knob-bar", parent);
    make("h3", "", bar).textContent = "The loop";
    this.resetAll = button(bar, "Reset all", "Reset the loop to its configuration", () => this.reset());
    this.architecture(parent);
    const interval = config.sample_time_s, most = Math.max(DELAY_SHOWN, 2 * config.channel.delay_s);
    this.row(parent, {
      id: "fraction", name: "Fraction compensated", symbol: "\u03b3", unit: "%", scale: 100, ends: [0, Math.max(FRACTION_SHOWN, config.compensation.fraction)],
      get: (at) => at.compensation.fraction, set: (at, value) => { at.compensation.fraction = value; }, round: (value) => Math.round(200 * value) / 200,
    });
    this.row(parent, {
      id: "delay", name: "Delay, each way", symbol: "T", unit: "ms", scale: 1000, ends: [0, most],
      get: (at) => at.channel.delay_s, set: (at, value) => { at.channel.delay_s = value; },
      round: (value) => Number((Math.round(value / interval) * interval).toPrecision(9)),
    });
    const { stiffness_n_m: stiffness, kind } = config.tissue;
    if (kind !== "none") this.row(parent, {
      id: "stiffness", name: "Stiffness of the tissue", symbol: "k", unit: "N/m", scale: 1, logarithmic: true,
      ends: [Math.min(STIFFNESS_SHOWN[0], stiffness || STIFFNESS_SHOWN[0]), Math.max(STIFFNESS_SHOWN[1], stiffness)],
      get: (at) => at.tissue.stiffness_n_m, set: (at, value) => { at.tissue.stiffness_n_m = value; }, round: (value) => Number(value.toPrecision(3)),
    });
    this.passivity(parent);
    this.message = make("p", "knob-message", parent);
    this.message.setAttribute("role", "status");
    this.reset();
  }

  architecture(parent) {
    const label = make("label", "knob-choice", parent);
    label.append("Architecture ");
    this.choice = make("select", "", label);
    for (const [value, words] of Object.entries(ARCHITECTURES)) {
      const option = make("option", "", this.choice);
      Object.assign(option, { value, textContent: words });
    }
    this.choice.addEventListener("change", () => { this.config.control.architecture = this.choice.value; this.refresh(); this.changed(); });
  }

  passivity(parent) {
    const label = make("label", "knob-alike", parent);
    this.guard = make("input", "", label);
    this.guard.type = "checkbox";
    label.append(" Passivity control");
    this.guard.addEventListener("change", () => { this.config.control.passivity = this.guard.checked; this.refresh(); this.changed(); });
  }

  row(parent, knob) {
    const row = make("div", "knob", parent), name = make("label", "", row), field = make("input", "", row);
    const [low, high] = knob.logarithmic ? knob.ends.map(Math.log) : knob.ends, inside = knob.logarithmic ? Math.log : Number;
    make("span", "unit", row).textContent = knob.unit;
    const track = make("div", "track", row), slider = make("input", "", track);
    const reset = button(row, "\u21ba", "Reset " + knob.name, () => this.set(knob, knob.get(this.found)));
    const part = (value) => clamp((inside(value) - low) / (high - low), 0, 1);
    make("span", "found", track).style.setProperty("--from", part(knob.get(this.found)));
    Object.assign(slider, { type: "range", min: 0, max: 1000, step: 1, id: "knob-" + knob.id });
    Object.assign(field, { type: "number", step: "any" });
    name.htmlFor = slider.id;
    name.append(knob.name + " ");
    make("i", "", name).textContent = knob.symbol;
    field.setAttribute("aria-label", knob.name + ", " + knob.unit);
    slider.addEventListener("input", () => {
      const at = low + (high - low) * slider.value / 1000;
      this.set(knob, knob.round(knob.logarithmic ? Math.exp(at) : at), slider);
    });
    field.addEventListener("change", () => {
      const value = field.valueAsNumber / knob.scale;
      if (Number.isFinite(value)) this.set(knob, value); else this.refresh();
    });
    this.rows.push({ knob, row, field, slider, reset, part });
  }

  set(knob, value, by) {
    knob.set(this.config, value);
    this.refresh(by);
    this.changed();
  }

  reset() {
    const isFirst = !this.config;
    this.config = structuredClone(this.found);
    this.refresh();
    if (!isFirst) this.changed();
  }

  // What the fields and sliders say; the one in use stays as it is.
  refresh(by) {
    const { control, sensor } = this.config;
    this.choice.value = control.architecture;
    this.guard.checked = control.passivity;
    for (const { knob, row, field, slider, reset, part } of this.rows) {
      const value = knob.get(this.config), text = precise(knob.scale * value);
      field.value = text.replace("\u2212", "-");
      row.dataset.value = value;
      if (slider !== by) slider.value = Math.round(1000 * part(value));
      slider.setAttribute("aria-valuetext", text + " " + knob.unit);
      reset.disabled = value === knob.get(this.found);
      const counts = ["position_force", "four_channel"].includes(control.architecture) && sensor.place === "outside";
      if (knob.id === "fraction") row.classList.toggle("idle", !counts);
    }
    this.resetAll.disabled = JSON.stringify(this.config) === JSON.stringify(this.found);
  }

  say(refusal) {
    this.message.textContent = refusal.split("\n")[0];
  }
}

const WATCHES = { motion: "Motion of the configuration", drag: "Drag the leader" };
const WATCH_HINTS = {
  motion: "The hand moves as the configuration says; the loop runs anew with every change.",
  drag: "Drag the handle under the lower chart, or focus it and use the arrow keys. Time runs while you hold it and a moment longer; " +
    "the purple bar is how far the tip lags behind your hand. After a change the same motion runs once more.",
};

class LiveLoop {
  constructor(element, data, runner) {
    this.data = data;
    this.runner = runner;
    this.element = element;
    this.modes();
    const body = make("div", "live-body", element);
    this.turned = new Turned(data.config, make("div", "knobs", body), () => this.changed());
    const view = make("div", "live-view", body);
    this.status(view);
    this.hint = make("p", "live-hint", view);
    this.panels(make("div", "charts", view));
    this.tools(view);
    this.setMode("motion");
    new ResizeObserver(() => { this.all.forEach((panel) => panel.plot.setSize(panel.size())); this.draw(); }).observe(view);
  }

  modes() {
    const group = make("div", "live-modes", this.element);
    group.setAttribute("role", "radiogroup");
    group.setAttribute("aria-label", "Motion of the hand");
    this.radios = {};
    for (const [mode, words] of Object.entries(WATCHES)) {
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
    this.said = { loop: entry("loop", "The loop"), displayed: entry("displayed", "Stiffness displayed"), error: entry("error", "Error of the force (rms)"),
      felt: entry("felt", "Force felt") };
    this.said.loop.setAttribute("role", "status");
  }

  panels(area) {
    const line = (name, style, sorted) => ({ name, style, kind: "line", sorted, x: new Float64Array(0), y: new Float64Array(0) });
    const data = (x, y, series, aspect, least) =>
      ({ title: "", x, y, limits: [0, 1, 0, 1], logarithmic: [false, false], aspect, least, gutter: 46, series, marks: [] });
    const linked = new Group("live", true), time = ["time", "s"], force = ["force", "N"];
    const forces = (sorted) => [line("trocar", "deflection", sorted), line("felt at the leader", "model", sorted), line("on the tissue", "fit", sorted)];
    this.path = new Panel(linked, data(time, ["position", "mm"],
      [line("hand", "neutral", true), line("leader", "model", true), line("follower", "alternative", true)], 0.2, 160), area);
    this.force = new Panel(linked, data(time, force, forces(true), 0.3, 190), area);
    linked.panels = [this.path, this.force];
    this.loop = new Panel(new Group("live-loop", false), data(["tip beyond the surface of the tissue", "mm"], force,
      [...forces(false), { ...line("", "fit", false), kind: "points" }], 0.36, 220), area);
    this.all = [this.path, this.force, this.loop];
    this.loop.box.classList.add("with-strip");
    this.strip = new Strip(this.loop, this.data.way.map((metres) => metres - this.surface), this.dragging(), "Position of the hand, mm");
    this.strip.position = this.data.start - this.surface;
  }

  get surface() {
    return this.data.config.tissue.surface_m;
  }

  tools(parent) {
    const bar = make("div", "tools", parent);
    this.anew = button(bar, "Start anew", "Start anew, at rest", () => this.restart());
    button(bar, "CSV", "Download motion and forces as CSV", () => save(new Blob([this.course.csv()], { type: "text/csv" }), "course.csv"));
  }

  setMode(mode) {
    this.mode = mode;
    this.element.dataset.mode = mode;
    this.radios[mode].checked = true;
    this.anew.hidden = mode !== "drag";
    this.hint.textContent = WATCH_HINTS[mode];
    this.restart();
  }

  restart() {
    this.course = null;
    this.wanted = [];
    this.begin = this.data.start;
    this.hand = { target: this.begin, most: Infinity, until: 0, held: this.mode === "drag" && this.hand && this.hand.held };
    this.changed();
  }

  // The hand's positions after each sample: of the configuration, or as they were dragged.
  hands() {
    if (this.mode === "drag") return this.wanted;
    const { middle_m: middle, amplitude_m: amplitude, frequency_hz: frequency, duration_s: duration } = this.turned.config.motion;
    const { sample_time_s: interval } = this.turned.config, count = Math.min(Math.ceil(duration / interval), Math.floor(LONGEST_COURSE / interval));
    return Array.from({ length: count }, (_, k) => middle - amplitude * Math.cos(2 * Math.PI * frequency * (k + 1) * interval));
  }

  // The same motion in the loop as it is now.
  changed() {
    const { config } = this.turned;
    this.course = new Course(this.runner, config, this.begin, config.sample_time_s);
    this.turned.say(this.course.refusal);
    this.settles = !this.course.refusal && this.runner.settles();
    this.course.append(this.hands());
    this.draw();
  }

  draw() {
    const { course } = this;
    if (!course) return;
    const drag = this.mode === "drag";
    const from = !drag ? 0 : reducedMotion() ? SHOWN_COURSE * Math.floor(course.end / SHOWN_COURSE) : Math.max(0, course.end - SHOWN_COURSE);
    const until = drag ? from + SHOWN_COURSE : Math.max(course.interval, this.hands().length * course.interval);
    const [time, hand, leader, follower, felt, trocar, tissue] = course.shown(from, ...COLUMNS.slice(0, 6));
    const mm = (column) => column.map((metres) => MM * metres), depth = follower.map((metres) => MM * (metres - this.surface));
    const way = this.data.way, along = way.map((metres) => MM * (metres - this.surface)), margin = 0.03 * (along[1] - along[0]);
    const deep = [along[0] - margin, along[1] + margin], high = this.range([felt, trocar, tissue]);
    const positions = this.reach([hand, leader, follower]).map((metres) => MM * metres);
    this.path.show([[time, mm(hand)], [time, mm(leader)], [time, mm(follower)]], [from, until, ...positions]);
    this.force.show([[time, trocar], [time, felt], [time, tissue]], [from, until, ...high]);
    const now = course.count - 1, point = now < 0 ? [new Float64Array(0), new Float64Array(0)] : [depth.slice(-1), tissue.slice(-1)];
    this.loop.data.marks = [{ axis: "x", from: 0, to: deep[1], label: "tissue" }];
    this.loop.show([[depth, trocar], [depth, felt], [depth, tissue], point], [...deep, ...high]);
    this.say();
    const at = course.hand.at(-1), tip = now < 0 ? at : course.last("follower_position_m");
    this.strip.show(at - this.surface, clamp(at - tip, -1, 1), (MM * (at - this.surface)).toFixed(1) + " mm beyond the surface");
  }

  // Forces that fit all that is drawn, rounded outwards, so that the axis rests while a slider moves a little.
  range(all) {
    let low = 0, high = 0;
    for (const values of all) for (const value of values) { low = Math.min(low, value); high = Math.max(high, value); }
    [low, high] = [clamp(low, -MOST_FORCE, 0), clamp(high, 0, MOST_FORCE)];
    const step = 10 ** Math.floor(Math.log10(Math.max(high - low, 0.1))) / 2;
    return [step * Math.floor((low - 0.1 * step) / step), step * Math.ceil((high + 0.1 * step) / step)];
  }

  reach(all) {
    let [low, high] = this.data.way;
    for (const values of all) for (const value of values) { low = Math.min(low, value); high = Math.max(high, value); }
    return [Math.max(low, this.data.way[0] - MOST_AWAY), Math.min(high, this.data.way[1] + MOST_AWAY)];
  }

  say() {
    const { course, said } = this, put = (node, text, value) => { node.textContent = text; node.dataset.value = value; };
    const number = (value, unit) => (Number.isFinite(value) ? precise(value) + " " + unit : "\u2013");
    const stable = this.settles && !course.diverged && !course.refusal;
    const words = course.refusal ? "refused" : course.diverged ? "unstable: diverged after " + precise(course.end) + " s"
      : this.settles ? "stable" : "unstable: does not come to rest after a push or pull";
    put(said.loop, words, stable);
    said.loop.classList.toggle("doubt", !stable);
    const figures = stable && course.count ? this.runner.figures() : {};
    put(said.displayed, number(figures.displayed, "N/m"), figures.displayed);
    if (Number.isFinite(figures.true)) make("small", "", said.displayed).textContent = "of the tissue " + number(figures.true, "N/m");
    put(said.error, number(figures.error, "N"), figures.error);
    if (Number.isFinite(figures.steps)) make("small", "", said.error).textContent = precise(figures.steps) + " just noticeable differences";
    const felt = stable ? course.last("felt_force_n") : NaN;
    put(said.felt, Number.isFinite(felt) ? felt.toFixed(2).replace(/^-(?=0\.?0*$)/, "").replace("-", "\u2212") + " N" : "\u2013", felt);
    if (stable && course.count) make("small", "", said.felt).textContent = "on the tissue " + course.last("tissue_force_n").toFixed(2) + " N";
  }

  // What the hand does: while it holds the handle, and a moment longer, time runs, a sample at a time.
  dragging() {
    const begin = () => { if (this.mode !== "drag") this.setMode("drag"); };
    const move = (depth) => { this.hand.target = clamp(depth + this.surface, ...this.data.way); };
    return {
      hold: () => { begin(); Object.assign(this.hand, { held: true, most: Infinity }); this.advance(); },
      move,
      release: () => { Object.assign(this.hand, { held: false, until: performance.now() + 1000 * LINGER }); },
      key: (step) => {
        begin();
        Object.assign(this.hand, { most: KEY_SPEED, until: performance.now() + 1000 * LINGER });
        move(this.hand.target - this.surface + step);
        this.advance();
      },
    };
  }

  advance() {
    if (this.isAdvancing) return;
    this.isAdvancing = true;
    let last = performance.now();
    const frame = () => {
      const { hand } = this, now = performance.now();
      const runs = this.mode === "drag" && (hand.held || now < hand.until) && !this.course.diverged && !this.course.refusal;
      if (!runs) { this.isAdvancing = false; return; }
      const each = 1000 * this.course.interval, passed = Math.min(LONGEST_FRAME, now - last), count = Math.floor(passed / each);
      last = now - last > LONGEST_FRAME ? now : last + count * each;
      if (count) { this.follow(count); this.draw(); }
      requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }

  // So many samples on: towards the pointer, softly, so that its steps do not become steps of the hand.
  follow(count) {
    const { hand, course } = this, soft = 1 - Math.exp(-course.interval / HAND), hands = [];
    let position = course.hand.at(-1);
    for (let i = 0; i < count; i++) {
      const left = hand.target - position, most = hand.most * course.interval;
      position = Math.abs(left) < CLOSE ? hand.target : position + clamp(soft * left, -most, most);
      hands.push(position);
    }
    if (course.end >= LONGEST_COURSE) { this.wanted = []; this.begin = course.hand.at(-1); this.changed(); return; }
    this.wanted.push(...hands);
    course.append(hands);
  }
}

async function goLiveLoop(element) {
  const [json, module] = element.querySelectorAll("script");
  const data = JSON.parse(json.textContent);
  const models = [data.trocar, data.compensator].map((row) => new Float64Array(bytesOf(row).buffer));
  const runner = await LoopRunner.start(module.textContent, models);
  element.querySelector(".live-absent").remove();
  const live = new LiveLoop(element, data, runner);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => live.all.forEach((panel) => panel.plot.redraw(false, true)));
}

goLiveLoop(document.getElementById("live")).catch((error) => console.error("live loop: " + error.message));
