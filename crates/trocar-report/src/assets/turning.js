
// What a live model with rotation has besides: the force in its ellipse, and a slider that turns the instrument.

const ELLIPSE_POINTS = 120;
const TURN_HINT = " The slider below the ellipse turns the instrument: what holds it around the shaft no longer holds it along the shaft.";

class Round {
  constructor(live, area, data, [line, dot]) {
    this.live = live;
    const series = [line("friction in all directions", "lower", false), line("model", "model", false), dot(false)];
    this.panel = new Panel(new Group("live-round", false), data(["force around the shaft", "N"], ["along it", "N"], series, 0.4, 220), area);
    const row = make("label", "live-turn", area);
    row.append("Turn the instrument, degrees ");
    this.slider = make("input", "", row);
    Object.assign(this.slider, { type: "range", min: -360, max: 360, step: 5, value: 0, id: "live-turn" });
    this.slider.addEventListener("input", () => this.turn(this.slider.valueAsNumber));
  }

  turn(degrees) {
    const { live } = this;
    if (live.mode !== "drag") live.setMode("drag");
    this.slider.value = degrees;
    live.identified = null;
    live.hand.turn(degrees * Math.PI / 180);
  }

  back() {
    this.slider.value = 0;
  }

  // Half axes: Coulomb forces along the shaft in both directions, and around it.
  draw(motion, from, now) {
    const { radius, ratio, coulomb } = this.live.data.turning;
    const [up, down] = coulomb.map((all) => all.reduce((sum, at) => sum + this.live.working[at], 0)), across = ratio * (up + down) / 2;
    const points = Array.from({ length: ELLIPSE_POINTS + 1 }, (_, i) => 2 * Math.PI * i / ELLIPSE_POINTS);
    const ellipse = [points.map((at) => across * Math.cos(at)), points.map((at) => (Math.sin(at) > 0 ? up : down) * Math.sin(at))];
    const [torque, force] = motion.columns(from, "torque", "force"), round = torque.map((value) => value / radius);
    const largest = (values, least) => values.reduce((most, value) => Math.max(most, Math.abs(value)), least);
    const [wide, high] = [1.1 * largest(round, across), 1.1 * largest(force, Math.max(up, down))];
    this.panel.show([ellipse.map((values) => Float64Array.from(values)), [round, force],
      [Float64Array.of(motion.torque[now] / radius), Float64Array.of(motion.force[now])]], [-wide, wide, -high, high]);
  }
}
