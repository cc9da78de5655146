
// What the live model and the live loop have in common: small helpers, and a handle to drag.

const MM = 1e3;
const KEY_STEP = 1e-3, KEY_SPEED = 0.04;  // m, m/s
const CLOSE = 1e-6;  // m
const LONGEST_FRAME = 200;  // ms; what a page misses while it is not shown is not made up for
const MOST_DRAWN = 3000;  // points a line

const bytesOf = (base64) => Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
const reducedMotion = () => matchMedia("(prefers-reduced-motion: reduce)").matches;
const clamp = (value, low, high) => Math.min(high, Math.max(low, value));
const precise = (value) => String(Number(value.toPrecision(4))).replace("-", "\u2212");

// Text with the indices of symbols set low, as the page does.
function typeset(element, text) {
  for (const [at, part] of text.split(/_([0-9A-Za-z]{1,2})(?![0-9A-Za-z])/).entries()) {
    if (at % 2) make("sub", "", element).textContent = part;
    else element.append(part);
  }
}

function button(parent, text, label, action) {
  const node = make("button", "", parent);
  node.type = "button";
  node.textContent = text;
  node.setAttribute("aria-label", label);
  node.addEventListener("click", action);
  return node;
}

// A handle under a chart, to be dragged along its x axis.
class Strip {
  constructor(panel, way, act, label) {
    this.panel = panel;
    this.way = way;
    this.act = act;
    this.position = way[0];
    this.box = make("div", "strip");
    panel.readout.before(this.box);
    this.seal = make("div", "strip-seal", this.box);
    this.handle = make("div", "strip-handle", this.box);
    const attributes = { role: "slider", tabindex: 0, "aria-label": label,
      "aria-valuemin": MM * way[0], "aria-valuemax": MM * way[1] };
    for (const [name, value] of Object.entries(attributes)) this.handle.setAttribute(name, value);
    this.box.addEventListener("pointerdown", (event) => this.grab(event));
    this.box.addEventListener("pointermove", (event) => this.pull(event));
    for (const end of ["pointerup", "pointercancel"]) this.box.addEventListener(end, (event) => this.drop(event));
    this.handle.addEventListener("keydown", (event) => this.key(event));
  }

  grab(event) {
    if (event.button !== 0) return;
    this.box.setPointerCapture(event.pointerId);
    this.handle.focus({ preventScroll: true });
    this.grip = { x: event.clientX, position: this.position };
    this.act.hold();
    event.preventDefault();
  }

  pull(event) {
    if (!this.grip) return;
    const { width } = this.box.getBoundingClientRect(), [low, high] = this.panel.full.x;
    this.act.move(this.grip.position + (event.clientX - this.grip.x) / width * (high - low) / MM);
  }

  drop(event) {
    if (!this.grip) return;
    this.pull(event);
    this.grip = null;
    this.act.release();
  }

  key(event) {
    const way = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -10, PageUp: 10 }[event.key];
    if (!way || event.ctrlKey || event.metaKey || event.altKey) return;
    this.act.key(way * KEY_STEP * (event.shiftKey ? 5 : 1));
    event.preventDefault();
  }

  // The handle, and a bar from it back by a deformation or a lag.
  show(position, behind, text) {
    const { plot, full } = this.panel, ratio = uPlot.pxRatio, [low, high] = full.x;
    const part = (metres) => 100 * (MM * metres - low) / (high - low) + "%";
    this.position = position;
    this.box.style.marginLeft = plot.bbox.left / ratio + "px";
    this.box.style.width = plot.bbox.width / ratio + "px";
    this.handle.style.left = part(position);
    const length = Number.isFinite(behind) ? behind : 0, from = Math.min(position, position - length);
    this.seal.style.left = part(from);
    this.seal.style.width = 100 * MM * Math.abs(length) / (high - low) + "%";
    this.handle.setAttribute("aria-valuenow", (MM * position).toFixed(1));
    this.handle.setAttribute("aria-valuetext", text);
  }
}
