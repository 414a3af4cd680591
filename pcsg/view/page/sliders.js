// A slider for every parameter of the axiom; SEED with dice, TIME that runs.

const GLOBALS = ["SEED", "TIME"];
const TIME_STEP = 1 / 24;

// A sensible range about a value that a grammar gives a parameter.
export function rangeOf(value) {
  const whole = Number.isInteger(value);
  if (value === 0) return { low: 0, high: 1, step: 0.01 };
  if (whole && Math.abs(value) <= 100) {
    const high = Math.max(10, 2 * Math.abs(value));
    return { low: value < 0 ? -high : 0, high, step: 1 };
  }
  const scale = 10 ** Math.floor(Math.log10(Math.abs(value)));
  const high = Math.ceil((2 * Math.abs(value)) / scale) * scale;
  return { low: value < 0 ? -high : 0, high, step: whole ? 1 : scale / 100 };
}

export class Sliders {
  // `change(values, moving, plays)` gets the values that differ from the grammar's; `plays` is the
  // parameter that runs by itself.
  constructor(element, change) {
    this.element = element;
    this.change = change;
    this.values = {};
    this.rows = new Map();
    this.signature = "";
  }

  // Show the parameters of a scene. `own` are the grammar's values, by which ranges are found.
  show(scene, values) {
    this.values = { ...values };
    const names = Object.keys(scene.parameters).filter((n) => !GLOBALS.includes(n));
    names.push(...GLOBALS.filter((n) => scene.reads.includes(n)));
    const signature = JSON.stringify([names, scene.own, scene.controls]);
    if (signature !== this.signature) this.build(names, scene);
    this.signature = signature;
    for (const [name, row] of this.rows) row.set(this.values[name] ?? scene.parameters[name]);
  }

  // Show other values.
  set(values) {
    this.values = { ...values };
    for (const [name, row] of this.rows) if (name in values) row.set(values[name]);
  }

  // The range of every parameter, by name.
  ranges() {
    return new Map([...this.rows].map(([name, row]) => [name, row.range]));
  }

  build(names, scene) {
    this.stop();
    this.rows.clear();
    const title = document.createElement("h2");
    title.textContent = "Parameters";
    const none = document.createElement("p");
    none.className = "soft";
    none.textContent = "The axiom assigns none: {n = 5} before it makes one.";
    const rows = names.map((name) => this.row(name, scene.own[name] ?? 0, scene.controls?.[name] ?? {}));
    const back = document.createElement("button");
    back.textContent = "Back to the grammar's values";
    back.addEventListener("click", () => {
      this.values = {};
      for (const [name, row] of this.rows) row.set(scene.own[name] ?? 0);
      this.change({}, false);
    });
    this.element.replaceChildren(title, ...(rows.length ? [...rows, back] : [none]));
  }

  row(name, own, control) {
    const range = { ...rangeOf(own), ...control };
    if (name === "SEED") Object.assign(range, { low: 0, high: 100, step: 1, ...control });
    if (name === "TIME") Object.assign(range, { low: 0, high: 10, step: TIME_STEP, ...control });
    const row = document.createElement("div");
    row.className = "parameter";
    const label = document.createElement("label");
    label.textContent = control.label ?? name;
    label.htmlFor = `value-${name}`;
    if (control.label) label.title = name;
    const number = document.createElement("input");
    Object.assign(number, { type: "number", id: `value-${name}`, step: "any" });
    const slider = document.createElement("input");
    Object.assign(slider, { type: "range", min: range.low, max: range.high, step: range.step });
    slider.setAttribute("aria-label", label.textContent);
    const take = (text, moving, plays) => {
      const value = Number(text);
      if (text === "" || !Number.isFinite(value)) return;
      number.value = slider.value = String(value);
      if (document.activeElement === number) number.value = text;
      this.values[name] = value;
      if (value === own && !GLOBALS.includes(name)) delete this.values[name];
      this.change({ ...this.values }, moving, plays);
    };
    slider.addEventListener("input", () => take(slider.value, true));
    slider.addEventListener("change", () => take(slider.value, false));
    number.addEventListener("change", () => take(number.value, false));
    row.append(label, number, slider);
    if (name === "SEED") row.append(this.button("Throw the dice", () => take(String(Math.floor(1e4 * Math.random())), false)));
    if (name === "TIME") range.play = 1;
    if (range.play) row.append(this.player(name, take, number, range));
    this.rows.set(name, { range, set: (value) => { if (document.activeElement !== number) number.value = value; slider.value = value; } });
    return row;
  }

  button(text, act) {
    const button = document.createElement("button");
    button.textContent = text;
    button.addEventListener("click", act);
    return button;
  }

  // Let a value run from the low end of its range to the high one, again and again.
  player(name, take, number, range) {
    const button = this.button("Play", () => {
      if (this.playing) return this.stop();
      button.textContent = "Pause";
      button.setAttribute("aria-pressed", "true");
      let before = performance.now();
      const step = (now) => {
        let value = Number(number.value) + ((now - before) / 1000) * range.play;
        before = now;
        if (value > range.high) value = range.low + ((value - range.high) % Math.max(range.high - range.low, 1e-9));
        take(value.toFixed(3), true, name);
        this.playing.frame = requestAnimationFrame(step);
      };
      this.playing = { frame: requestAnimationFrame(step), button };
    });
    return button;
  }

  stop() {
    if (!this.playing) return;
    cancelAnimationFrame(this.playing.frame);
    this.playing.button.textContent = "Play";
    this.playing.button.removeAttribute("aria-pressed");
    this.playing = null;
    this.change({ ...this.values }, false);
  }
}
