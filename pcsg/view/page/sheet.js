// A sheet of small pictures of one parameter; a click takes its value.

const TILES = 16;
const SIZE = [240, 180];

// Values from one end of a range to the other, whole ones where its steps are whole.
export function stepsOf(name, { low, high, step }) {
  if (name === "SEED") return Array.from({ length: TILES }, (_, k) => k + 1);
  const whole = Number.isInteger(step) && Number.isInteger(low);
  const values = Array.from({ length: TILES }, (_, k) => low + ((high - low) * k) / (TILES - 1));
  return [...new Set(values.map((x) => (whole ? Math.round(x) : Number(x.toPrecision(4)))))];
}

export class Sheet {
  // `acts` has `ask(name, steps, size)`, `take(name, value)` and `close()`.
  constructor(dialog, acts) {
    this.dialog = dialog;
    this.acts = acts;
    [this.title, this.tiles] = ["h2", "#tiles"].map((selector) => dialog.querySelector(selector));
    dialog.addEventListener("close", () => {
      for (const image of this.tiles.querySelectorAll("img")) URL.revokeObjectURL(image.src);
      acts.close();
    });
  }

  open(ranges) {
    this.ranges = ranges;
    const choice = document.createElement("select");
    choice.setAttribute("aria-label", "Parameter");
    for (const name of ranges.keys()) choice.append(new Option(name));
    if (ranges.has("SEED")) choice.value = "SEED";
    choice.addEventListener("change", () => this.begin(choice.value));
    this.title.replaceChildren("Sheet of ", choice);
    this.tiles.textContent = "";
    this.dialog.showModal();
    if (ranges.size) this.begin(choice.value);
    else this.tiles.textContent = "The grammar has no parameters.";
  }

  begin(name) {
    this.name = name;
    const steps = stepsOf(name, this.ranges.get(name));
    this.tiles.replaceChildren(
      ...steps.map((value) => {
        const button = document.createElement("button");
        const empty = document.createElement("span");
        empty.className = "empty";
        button.append(empty, `${name} = ${value}`);
        button.addEventListener("click", () => {
          this.dialog.close();
          this.acts.take(name, value);
        });
        return button;
      }),
    );
    this.acts.ask(name, steps, SIZE);
  }

  show(tile) {
    const button = this.tiles.children[tile.index];
    if (!button) return;
    if (tile.error) {
      button.title = tile.error;
      button.firstChild.textContent = "no picture";
      return;
    }
    const image = document.createElement("img");
    image.src = URL.createObjectURL(tile.blob);
    image.alt = `${this.name} = ${tile.value}`;
    button.firstChild.replaceWith(image);
  }
}
