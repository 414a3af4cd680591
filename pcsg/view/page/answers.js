// What stands at a point of the picture: rule, line, values, coordinates; distances between two.

const short = (x) => String(Number(Number(x).toPrecision(6)));
const vector = (v) => v.map(short).join(", ").replaceAll(" ", "\n");

export class Answers {
  // `jump(line)` shows a line of the text.
  constructor(element, jump) {
    this.element = element;
    this.jump = jump;
    this.before = null;
  }

  show(answer) {
    const title = document.createElement("h2");
    title.textContent = "Under the click";
    const parts = [title];
    if (!answer.hit) {
      parts.push(this.text("Nothing: the sky."));
      this.before = null;
    } else {
      if (answer.line) parts.push(this.line(answer));
      parts.push(this.list(this.facts(answer)));
      // The same point is told again, once its derivation is found.
      if (!answer.partial) this.before = answer.position;
    }
    this.element.replaceChildren(...parts);
  }

  facts(answer) {
    const facts = [["solid", answer.what]];
    if (answer.derivation) facts.push(["derived", answer.derivation]);
    for (const [name, value] of Object.entries(answer.values ?? {})) facts.push([name, short(value)]);
    if (answer.label >= 0) facts.push(["label", answer.label]);
    if (answer.material) facts.push(["material", answer.material]);
    facts.push(["position", vector(answer.position)], ["normal", vector(answer.normal)], ["distance", short(answer.distance)]);
    if (this.before) {
      const apart = Math.hypot(...answer.position.map((x, k) => x - this.before[k]));
      facts.push(["from the one before", short(apart)]);
    }
    return facts;
  }

  line(answer) {
    const button = document.createElement("button");
    button.className = "source";
    button.title = "Show this line in the text";
    button.textContent = `${answer.file}:${answer.line}\n${answer.source}`;
    button.addEventListener("click", () => this.jump(answer.line, answer.column));
    return button;
  }

  text(words) {
    const paragraph = document.createElement("p");
    paragraph.textContent = words;
    return paragraph;
  }

  list(facts) {
    const list = document.createElement("dl");
    for (const [name, value] of facts) {
      const term = document.createElement("dt"), meaning = document.createElement("dd");
      term.textContent = name;
      meaning.textContent = value;
      list.append(term, meaning);
    }
    return list;
  }
}
