
// The models in a page: the WebAssembly module, motions with what it answered, and the hand that moves the instrument.
// Inside all numbers are in SI; millimetres stand on the screen only.

const MILLISECOND = 1e-3;
const LONGEST_DRAG = 300;  // s
const KEY_WAIT = 0.3;  // s
const GRIP = 1 - Math.exp(-1 / 30);  // part of the way to the hand in a step
const CLOSE_ANGLE = 1e-4;  // rad

// The WebAssembly module, crates/trocar-web: one model and its state.
class Runner {
  static async start(compressed, row) {
    const plain = new Blob([bytesOf(compressed)]).stream().pipeThrough(new DecompressionStream("gzip"));
    const { instance } = await WebAssembly.instantiate(await new Response(plain).arrayBuffer());
    return new Runner(instance.exports, row);
  }

  constructor(module, row) {
    this.module = module;
    const place = (name, count) => new Float64Array(module.memory.buffer, module[name](), count);
    place("row", row.length).set(row);
    if (!module.load(row.length)) throw new Error("the module reads no model");
    this.values = place("values", module.values_length());
    this.length = module.block_length();
    const block = place("block", 7 * this.length);
    this.columns = [0, 1, 2, 3, 4, 5, 6].map((at) => block.subarray(at * this.length, (at + 1) * this.length));
  }

  // Whether the values make a model; the state is at rest where it was, with the force it had.
  tune(values) {
    this.values.set(values);
    return this.module.tune(values.length) === 1;
  }

  // At rest, undeformed or with a force, at the angle 0.
  rest(position, force) {
    if (force === undefined) this.module.rest(position);
    else this.module.rest_at_force(position, force);
  }

  // Up to a block of steps; views on force, deflection, sliding and torque, good until the next call.
  run(positions, durations, angles) {
    this.columns[0].set(positions);
    this.columns[1].set(durations);
    this.columns[2].set(angles);
    const made = this.module.run(positions.length);
    return this.columns.slice(3).map((column) => column.subarray(0, made));
  }
}

// A motion with what the model answered. Durations are differences of the times, as in every program of this project.
class Motion {
  constructor(runner, time, position, force) {
    Object.assign(this, { runner, time: [], position: [], angle: [], force: [], deflection: [], sliding: [], torque: [] });
    runner.rest(position, force);
    this.append([time], [position], [0]);
  }

  // Angles begin at 0; without any the instrument does not turn.
  static along(runner, times, positions, force, angles) {
    const motion = new Motion(runner, times[0], positions[0], force);
    motion.append(times.slice(1), positions.slice(1), angles && angles.slice(1));
    return motion;
  }

  append(times, positions, given) {
    const angles = given || new Float64Array(times.length);
    for (let from = 0; from < times.length; from += this.runner.length) {
      const some = positions.slice(from, from + this.runner.length);
      const durations = Array.from(some, (_, i) => {
        const before = from + i > 0 ? times[from + i - 1] : this.time.length ? this.time.at(-1) : times[0];
        return times[from + i] - before;
      });
      const answered = this.runner.run(some, durations, angles.slice(from, from + this.runner.length));
      for (const [at, name] of ["force", "deflection", "sliding", "torque"].entries())
        for (let i = 0; i < some.length; i++) this[name].push(answered[at][i]);
    }
    for (let i = 0; i < times.length; i++) {
      this.time.push(times[i]);
      this.position.push(positions[i]);
      this.angle.push(angles[i]);
    }
  }

  get end() {
    return this.time.length - 1;
  }

  // Columns of the samples from a time on, as many as show on the screen.
  columns(from, ...names) {
    const first = Math.max(0, this.time.findIndex((time) => time >= from)), count = this.time.length - first;
    const every = Math.max(1, Math.ceil(count / MOST_DRAWN)), shown = Math.ceil(count / every);
    return names.map((name) => Float64Array.from({ length: shown }, (_, i) => {
      const at = Math.min(this.end, first + i * every), value = this[name][i === shown - 1 ? this.end : at];
      return name === "position" ? MM * value : value;
    }));
  }

  csv() {
    const turns = this.angle.some((angle) => angle !== 0), more = (i) => (turns ? [this.angle[i], this.torque[i]] : []);
    const rows = this.time.map((time, i) => [time, this.position[i], this.force[i], ...more(i)].join());
    return "time_s,position_m,force_n" + (turns ? ",angle_rad,torque_n_m" : "") + "\n" + rows.join("\n") + "\n";
  }
}

// The hand of `owner`, which has a runner, a motion, whether it `isMoved` by hand, and is told of each frame (`moved`) and of
// the end (`rested`): while the hand holds the instrument time runs, in steps of a millisecond.
class Hand {
  constructor(owner, way) {
    Object.assign(this, { owner, way });
  }

  // Lets go, at a position and the angle 0.
  rest(position) {
    Object.assign(this, { target: position, angle: 0, held: false, until: 0, most: Infinity });
  }

  // Turns the instrument to an angle, rad.
  turn(angle) {
    this.angle = angle;
    this.advance();
  }

  hold() {
    Object.assign(this, { held: true, most: Infinity });
    this.advance();
  }

  move(position) {
    this.target = clamp(position, ...this.way);
  }

  release() {
    this.held = false;
  }

  key(step) {
    Object.assign(this, { most: KEY_SPEED * MILLISECOND, until: performance.now() + 1000 * KEY_WAIT });
    this.move(this.target + step);
    this.advance();
  }

  advance() {
    if (this.isAdvancing) return;
    this.isAdvancing = true;
    let last = performance.now();
    const frame = () => {
      const { owner } = this, now = performance.now();
      const arrived = this.target === owner.motion.position.at(-1) && this.angle === owner.motion.angle.at(-1);
      if (!owner.isMoved || !(this.held || now < this.until || !arrived)) {
        this.isAdvancing = false;
        if (owner.isMoved) owner.rested();
        return;
      }
      const count = Math.min(LONGEST_FRAME, Math.floor(now - last));
      last = now - last > LONGEST_FRAME ? now : last + count;
      if (count) { this.follow(count); owner.moved(); }
      requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }

  // So many milliseconds on: towards the hand, softly, so that the steps of a pointer do not become steps of the instrument.
  follow(count) {
    const { owner } = this;
    if (owner.motion.time.at(-1) >= LONGEST_DRAG) {
      owner.motion = new Motion(owner.runner, 0, owner.motion.position.at(-1));
      this.angle = 0;
      owner.round?.back();
    }
    const { motion } = owner, first = motion.end, times = [], positions = [], angles = [];
    let position = motion.position.at(-1), angle = motion.angle.at(-1);
    for (let i = 1; i <= count; i++) {
      const left = this.target - position, round = this.angle - angle;
      position = Math.abs(left) < CLOSE ? this.target : position + clamp(GRIP * left, -this.most, this.most);
      angle = Math.abs(round) < CLOSE_ANGLE ? this.angle : angle + GRIP * round;
      times.push((first + i) / 1000);
      positions.push(position);
      angles.push(angle);
    }
    motion.append(times, positions, angles);
  }
}
