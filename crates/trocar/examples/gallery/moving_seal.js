
// A seal that the reader moves: dragged by pointer, finger or keys, or played. What moves is redrawn as moving_seal.rs draws it.

const SHOWN = 10;  // s
const TRAIL_POINTS = 500;
const signed = (value) => value.toFixed(2).replace(/^-(?=0\.00$)/, "").replace("-", "\u2212");

// Times and positions along turns at a constant speed, in steps of a millisecond, with a pause at each turn.
function course(turns, { speed, pause }) {
  const positions = [turns[0]];
  for (let k = 1; k < turns.length; k++) {
    const steps = Math.round(Math.abs(turns[k] - turns[k - 1]) / speed / MILLISECOND);
    for (let i = 1; i <= steps; i++) positions.push(turns[k - 1] + (turns[k] - turns[k - 1]) * i / steps);
    for (let i = 0; i < pause / MILLISECOND; i++) positions.push(turns[k]);
  }
  return [positions.map((_, i) => i / 1000), positions];
}

// The lip between wall and shaft: a strip of constant length, on one side of its clamp up to the join, on the other after it.
class Lip {
  constructor(data) {
    const { scale, bulge, surface, clamp: [, wall], thickness } = data.section;
    Object.assign(this, { data, width: MM * data.half_width, height: surface - wall - 0.5 * thickness[1] });
    this.long = this.length(this.strip(scale * this.width, bulge * scale * this.width, 1));
  }

  // The middle of the branches or half their distance at a deflection.
  between(values, deflection) {
    const at = clamp((deflection / this.data.half_width + 1) / 2, 0, 1) * (values.length - 1), below = Math.floor(at);
    return values[below] + (at - below) * (values[Math.min(below + 1, values.length - 1)] - values[below]);
  }

  side(deflection, force) {
    const { data } = this, gap = this.between(data.half_gap, deflection), [on, off] = data.joins;
    const part = gap < data.section.narrowest ? 0 : clamp((force - this.between(data.mid, deflection)) / gap, -1, 1);
    return Math.tanh((deflection - 0.5 * (on + off) - 0.5 * part * (on - off)) / (data.section.snap * data.half_width));
  }

  strip(z, bulge, side) {
    const { points, clamp: [x, y] } = this.data.section, double = Math.sqrt(Math.max(0, 1 - side * side));
    return Array.from({ length: points }, (_, k) => {
      const t = k / (points - 1), single = 6.75 * t * (1 - t) * (1 - t);
      return [x + z * t - bulge * (side * single + 0.6 * double * Math.sin(2 * Math.PI * t)), y + this.height * t];
    });
  }

  length(line) {
    return line.slice(1).reduce((sum, [x, y], k) => sum + Math.hypot(x - line[k][0], y - line[k][1]), 0);
  }

  path(deflection, force) {
    const { scale } = this.data.section, z = scale * MM * deflection, side = this.side(deflection, force);
    let low = 0, high = 3 * scale * this.width;
    for (let k = 0; k < 30; k++) {
      const bulge = 0.5 * (low + high);
      if (this.length(this.strip(z, bulge, side)) > this.long) high = bulge; else low = bulge;
    }
    return this.around(this.strip(z, low, side));
  }

  around(line) {
    const { thickness: [thick, thin], surface } = this.data.section, last = line.length - 1;
    const side = (k, sign) => {
      const a = line[Math.max(0, k - 1)], b = line[Math.min(last, k + 1)], dx = b[0] - a[0], dy = b[1] - a[1];
      const half = 0.5 * sign * (thick + (thin - thick) * k / last) / Math.hypot(dx, dy);
      return (line[k][0] - half * dy).toFixed(1) + " " + Math.min(line[k][1] + half * dx, surface).toFixed(1);
    };
    const there = line.map((_, k) => side(k, 1)), back = line.map((_, k) => side(k, -1)).reverse();
    return "M" + [...there, ...back].join("L") + "Z";
  }
}

class MovingSeal {
  constructor(root, data, runner) {
    Object.assign(this, { root, data, runner, lip: new Lip(data), hand: new Hand(this, data.way) });
    const find = (name) => root.querySelector(name);
    this.section = find(".seal-section");
    this.shaft = find(".seal-shaft");
    this.lips = find(".seal-lips");
    this.paths = root.querySelectorAll("path.seal-lip");
    this.arrow = find(".seal-force");
    this.gauge = find(".seal-z");
    this.charts = [...root.querySelectorAll(".seal-chart")].map((chart) =>
      ({ x: chart.dataset.chart, trail: chart.querySelector(".seal-trail"), dot: chart.querySelector(".seal-dot") }));
    this.said = Object.fromEntries([...root.querySelectorAll("[data-seal]")].map((node) => [node.dataset.seal, node]));
    this.button = find(".seal-tools button");
    root.querySelector(".seal-tools span").textContent = "Drag the instrument to and fro, or focus it and use the arrow keys.";
    this.played = this.cycle();
    const [low, high] = data.way;
    this.begin(...course([low, high, low, (low + high) / 2], data));
    this.listen();
    root.dataset.live = "";
    if (root.closest("[data-mode=play]") && !reducedMotion()) this.play(); else this.draw(this.motion, this.motion.end);
  }

  // One cycle that begins as the cycle before it ended.
  cycle() {
    const [times, positions] = course(this.data.turns, this.data);
    const before = Motion.along(this.runner, times, positions), count = before.end + 1;
    before.append(positions.map((_, i) => (count + i) / 1000), positions);
    return { motion: before, from: count };
  }

  // What was before leaves no trail.
  begin(times, positions) {
    this.motion = Motion.along(this.runner, times, positions);
    this.begun = this.motion.end;
    this.hand.rest(this.motion.position.at(-1));
  }

  listen() {
    const { section, hand } = this, way = this.data.way.map((metres) => MM * metres);
    const attributes = { role: "slider", tabindex: 0, "aria-label": "Position of the instrument in the trocar, mm",
      "aria-valuemin": way[0], "aria-valuemax": way[1] };
    for (const [name, value] of Object.entries(attributes)) section.setAttribute(name, value);
    section.addEventListener("pointerdown", (event) => this.grab(event));
    section.addEventListener("pointermove", (event) => this.pull(event));
    for (const end of ["pointerup", "pointercancel"]) section.addEventListener(end, () => { this.grip = null; hand.release(); });
    section.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -10, PageUp: 10 }[event.key];
      if (!step || event.ctrlKey || event.metaKey || event.altKey) return;
      this.stop();
      hand.key(step * KEY_STEP * (event.shiftKey ? 5 : 1));
      event.preventDefault();
    });
    this.button.hidden = false;
    this.button.addEventListener("click", () => (this.playing ? this.stop() : this.play()));
  }

  grab(event) {
    if (event.button !== 0) return;
    this.stop();
    this.section.setPointerCapture(event.pointerId);
    this.section.focus({ preventScroll: true });
    this.grip = { x: event.clientX, position: this.motion.position.at(-1) };
    this.hand.move(this.grip.position);
    this.hand.hold();
    event.preventDefault();
  }

  pull(event) {
    if (!this.grip) return;
    const { width } = this.section.getBoundingClientRect(), { scale } = this.data.section;
    const pixels = (event.clientX - this.grip.x) / width * this.section.viewBox.baseVal.width;
    this.hand.move(this.grip.position + pixels / scale / MM);
  }

  get isMoved() {
    return !this.playing;
  }

  moved() {
    if (this.motion.end < this.begun) this.begun = 0;
    this.draw(this.motion, this.motion.end);
  }

  rested() {
    this.moved();
  }

  play() {
    this.playing = true;
    this.button.textContent = "Stop";
    const { motion, from } = this.played, count = motion.end + 1 - from, begun = performance.now();
    const frame = () => {
      if (!this.playing) return;
      this.shown = from + Math.floor(performance.now() - begun) % count;
      this.draw(motion, this.shown);
      requestAnimationFrame(frame);
    };
    frame();
  }

  // The hand goes on with the seal as it was last seen.
  stop() {
    if (!this.playing) return;
    this.playing = false;
    this.button.textContent = "Play";
    const { motion } = this.played;
    this.begin(motion.time.slice(0, this.shown + 1), motion.position.slice(0, this.shown + 1));
    this.moved();
  }

  draw(motion, now) {
    const { data, said } = this, { scale, clamp: [x], surface } = data.section;
    const position = MM * motion.position[now], deflection = motion.deflection[now], force = motion.force[now], z = MM * deflection;
    this.shaft.setAttribute("transform", `translate(${(scale * (position - MM * data.way[0])).toFixed(2)} 0)`);
    const path = this.lip.path(deflection, force);
    for (const lip of this.paths) lip.setAttribute("d", path);
    this.lips.dataset.sliding = motion.sliding[now];
    const long = data.section.per_newton * force, head = Math.min(Math.abs(long), 8) * Math.sign(long);
    this.arrow.setAttribute("d", `M${x} ${surface + 25}h${long.toFixed(2)}m${(-head).toFixed(2)} -5l${head.toFixed(2)} 5l${(-head).toFixed(2)} 5`);
    this.gauge.setAttribute("cx", (x + scale * z).toFixed(2));
    const first = Math.max(motion === this.motion ? Math.min(this.begun, now) : 0, now - SHOWN / MILLISECOND), every = Math.max(1, Math.ceil((now - first) / TRAIL_POINTS));
    for (const chart of this.charts) {
      const points = [], add = (i) => points.push((MM * motion[chart.x][i]).toFixed(3) + "," + motion.force[i].toFixed(3));
      for (let i = Math.ceil(first / every) * every; i < now; i += every) add(i);
      add(now);
      chart.trail.setAttribute("points", points.join(" "));
      chart.dot.setAttribute("d", `M${points.at(-1).replace(",", " ")}h0`);
    }
    const put = (name, text, value) => { said[name].textContent = text; said[name].dataset.value = value; };
    put("force", signed(force) + " N", force);
    put("deflection", signed(z) + " mm", deflection);
    put("position", signed(position) + " mm", motion.position[now]);
    put("sliding", motion.sliding[now] ? "slides" : "deforms", motion.sliding[now]);
    this.section.setAttribute("aria-valuenow", position.toFixed(1));
    this.section.setAttribute("aria-valuetext", `${position.toFixed(1)} mm, ${force.toFixed(2)} N, the seal ${said.sliding.textContent}`);
  }
}

async function moveSeal(root) {
  const [json, module] = root.querySelectorAll("script");
  const data = JSON.parse(json.textContent);
  root.seal = new MovingSeal(root, data, await Runner.start(module.textContent, new Float64Array(bytesOf(data.row).buffer)));
}

moveSeal(document.currentScript.parentElement).catch((error) => console.error("moving seal: " + error.message));
