// Curves of a growing tree, dragged by hand: points move, come and go; the tree follows.

const WIDTH = 250, HEIGHT = 170, EDGE = 8, LEAST = 0.001;
const make = (tag, attributes) => {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  return element;
};

// A species' text with another curve, all else as it was written.
export function withCurve(text, name, curve) {
  const points = curve.points.map(([x, y]) => `[${Number(x.toPrecision(5))}, ${Number(y.toPrecision(5))}]`).join(", ");
  const written = `"${name}": {"type": "${curve.type}", "points": [${points}]}`;
  const before = new RegExp(`"${name}"\\s*:\\s*\\{[^{}]*\\}`);
  if (before.test(text)) return text.replace(before, () => written);
  const data = JSON.parse(text);
  data.curves = { ...data.curves, [name]: { type: curve.type, points: curve.points } };
  return JSON.stringify(data, null, 2) + "\n";
}

export class Curves {
  // `acts` has `text()`, `draft(text, moving)`, `save()` and `download(text)`.
  constructor(element, acts) {
    this.element = element;
    this.acts = acts;
    this.past = [];
    this.curves = null;
  }

  show(curves) {
    this.element.hidden = !curves;
    if (!curves) return;
    if (!this.curves) this.build(curves);
    if (this.held === undefined) this.curves = curves;
    else this.curves[this.name].line = curves[this.name].line; // the points are in the hand
    this.draw();
  }

  get name() {
    return this.choice.value;
  }

  get curve() {
    return this.curves[this.name];
  }

  build(curves) {
    const title = document.createElement("h2");
    title.textContent = "Curves";
    this.choice = document.createElement("select");
    this.choice.setAttribute("aria-label", "Curve");
    for (const [name, { title }] of Object.entries(curves)) this.choice.append(new Option(`${name}: ${title}`, name));
    this.kind = document.createElement("select");
    this.kind.setAttribute("aria-label", "How points are joined");
    for (const kind of ["pchip", "bspline", "linear"]) this.kind.append(new Option(kind));
    this.plot = make("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "plot", role: "group", "aria-label": "Points of the curve" });
    this.hint = document.createElement("p");
    this.hint.className = "soft";
    this.hint.textContent = "Drag points; double-click adds one; Delete removes the one in focus.";
    const row = document.createElement("div");
    row.className = "row";
    row.append(
      this.button("Undo", () => this.undo()),
      this.button("Save", () => this.acts.save()),
      this.button("Save as a file", () => this.acts.download(this.acts.text())),
    );
    this.choice.addEventListener("change", () => this.draw());
    this.kind.addEventListener("change", () => this.change((curve) => (curve.type = this.kind.value)));
    this.plot.addEventListener("pointermove", (event) => this.drag(event));
    for (const end of ["pointerup", "pointercancel"]) this.plot.addEventListener(end, () => this.drop());
    this.plot.addEventListener("dblclick", (event) => this.insert(this.at(event)));
    this.element.replaceChildren(title, this.choice, this.plot, this.hint, this.kind, row);
  }

  button(text, act) {
    const button = document.createElement("button");
    button.textContent = text;
    button.addEventListener("click", act);
    return button;
  }

  // The range of y that is drawn: what the curve has, with some room.
  range() {
    if (this.held !== undefined && this.shown) return this.shown;
    const values = this.curve.points.map(([, y]) => y);
    const low = Math.min(0, ...values), high = Math.max(...values, low + 1e-6);
    const room = 0.15 * (high - low);
    this.shown = [Math.max(this.curve.low, low - (low < 0 ? room : 0)), Math.min(this.curve.high, high + room)];
    return this.shown;
  }

  toPlot([x, y]) {
    const [low, high] = this.range();
    return [EDGE + x * (WIDTH - 2 * EDGE), HEIGHT - EDGE - ((y - low) / (high - low)) * (HEIGHT - 2 * EDGE)];
  }

  at(event) {
    const box = this.plot.getBoundingClientRect(), [low, high] = this.range();
    const x = ((event.clientX - box.left) / box.width) * WIDTH, y = ((event.clientY - box.top) / box.height) * HEIGHT;
    return [(x - EDGE) / (WIDTH - 2 * EDGE), low + ((HEIGHT - EDGE - y) / (HEIGHT - 2 * EDGE)) * (high - low)];
  }

  draw() {
    this.kind.value = this.curve.type;
    const line = make("polyline", { class: "line", points: this.curve.line.map((p) => this.toPlot(p).join()).join(" ") });
    const zero = this.toPlot([0, 0])[1];
    const axis = make("line", { class: "axis", x1: EDGE, x2: WIDTH - EDGE, y1: zero, y2: zero });
    const focused = [...this.plot.querySelectorAll("circle")].indexOf(document.activeElement);
    const points = this.curve.points.map((point, k) => this.point(point, k));
    this.plot.replaceChildren(axis, line, ...points);
    points[focused]?.focus();
  }

  point(point, k) {
    const [cx, cy] = this.toPlot(point);
    const label = `point ${k + 1}: ${point.map((v) => Number(v.toPrecision(4))).join(", ")}`;
    const circle = make("circle", { cx, cy, r: 5.5, tabindex: 0, role: "slider", "aria-label": label, "aria-valuenow": point[1], "aria-valuetext": label });
    circle.addEventListener("pointerdown", (event) => {
      event.preventDefault();
      this.keep();
      this.held = k;
      circle.focus();
      this.plot.setPointerCapture(event.pointerId);
    });
    circle.addEventListener("keydown", (event) => this.key(event, k));
    return circle;
  }

  key(event, k) {
    const [low, high] = this.range(), [x, y] = this.curve.points[k];
    const step = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [-1, 0], ArrowRight: [1, 0] }[event.key];
    if (step) this.change((curve) => (curve.points[k] = this.inside([x + 0.01 * step[0], y + (0.02 * step[1]) * (high - low)], k)));
    else if (event.key === "Delete" && k > 0 && k < this.curve.points.length - 1) this.change((curve) => curve.points.splice(k, 1));
    else return;
    event.preventDefault();
  }

  // Between its neighbours, and within what the curve may be; the ends stay at 0 and 1.
  inside([x, y], k) {
    const { points, low, high } = this.curve;
    const last = points.length - 1;
    const left = k > 0 ? points[k - 1][0] + LEAST : 0, right = k < last ? points[k + 1][0] - LEAST : 1;
    const clamp = (v, a, b) => Math.min(b, Math.max(a, v));
    return [k === 0 ? 0 : k === last ? 1 : clamp(x, left, right), clamp(y, low, high)];
  }

  drag(event) {
    if (this.held === undefined) return;
    this.curve.points[this.held] = this.inside(this.at(event), this.held);
    this.acts.draft(this.text(), true);
    this.draw();
  }

  drop() {
    if (this.held === undefined) return;
    this.held = undefined;
    this.acts.draft(this.text(), false);
  }

  insert(place) {
    const k = this.curve.points.findIndex(([x]) => x > place[0]);
    if (k > 0) this.change((curve) => { curve.points.splice(k, 0, place); curve.points[k] = this.inside(place, k); });
  }

  change(act) {
    this.keep();
    act(this.curve);
    this.acts.draft(this.text(), false);
    this.draw();
  }

  text() {
    return withCurve(this.acts.text(), this.name, this.curve);
  }

  keep() {
    this.past.push({ name: this.name, text: this.acts.text() });
  }

  undo() {
    const before = this.past.pop();
    if (!before) return;
    this.choice.value = before.name;
    this.acts.draft(before.text, false);
  }
}
