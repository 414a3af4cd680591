// The pane with the grammar's text: colours, line numbers, mistakes underlined, saving.

const TOKEN = /(\/\/[^\n]*|\/\*[\s\S]*?(?:\*\/|$))|("[^"\n]*"?)|(\b\d+(?:\.\d*)?(?:[eE][+-]?\d+)?\b|\.\d+)|([A-Za-z_]\w*)|(#\w+)/g;
const KINDS = ["comment", "string", "number", "word", "word"];

// A text as pieces with the class that colours each.
function pieces(text, words) {
  const found = [];
  let end = 0;
  for (const match of text.matchAll(TOKEN)) {
    const kind = KINDS[match.slice(1).findIndex((group) => group !== undefined)];
    if (kind === "word" && !match[5] && !words.has(match[0])) continue;
    if (match.index > end) found.push([text.slice(end, match.index), ""]);
    found.push([match[0], kind]);
    end = match.index + match[0].length;
  }
  found.push([text.slice(end), ""]);
  return found;
}

export class TextPane {
  // `save(text, base)` writes the file, whose text was `base` when it was read.
  constructor(element, save) {
    this.element = element;
    this.save = save;
    this.words = new Set();
    this.base = null;
    this.errors = [];
    this.build();
  }

  build() {
    this.element.innerHTML = `
      <div class="row text-tools">
        <button class="main" title="Save the file (Ctrl-S)">Save</button>
        <span class="soft text-state"></span>
      </div>
      <div class="editor">
        <pre class="gutter" aria-hidden="true"></pre>
        <div class="sheet"><pre class="colours" aria-hidden="true"></pre>
        <textarea spellcheck="false" autocomplete="off" autocapitalize="off" wrap="off" aria-label="Text of the grammar"></textarea></div>
      </div>`;
    const find = (selector) => this.element.querySelector(selector);
    [this.button, this.state, this.gutter, this.colours, this.area] =
      ["button", ".text-state", ".gutter", ".colours", "textarea"].map(find);
    this.button.addEventListener("click", () => this.store());
    this.area.addEventListener("input", () => this.draw());
    this.area.addEventListener("scroll", () => this.scroll());
    this.area.addEventListener("keydown", (event) => {
      if ((event.ctrlKey || event.metaKey) && event.key === "s") {
        event.preventDefault();
        this.store();
      }
    });
    window.addEventListener("beforeunload", (event) => this.isChanged && event.preventDefault());
  }

  get isChanged() {
    return this.base !== null && this.area.value !== this.base;
  }

  store() {
    if (this.base !== null) this.save(this.area.value, this.conflict ?? this.base);
  }

  // The file's text has come. What was changed here and is not saved stays.
  show(text, note) {
    if (text === null) {
      this.note(note);
      return;
    }
    if (this.isChanged && this.area.value !== text) {
      this.conflict = text;
      this.note("The file was changed elsewhere. Save writes your text in its place.");
      this.reloadButton(text);
      return;
    }
    this.take(text);
    this.note(note ?? "");
  }

  take(text) {
    const { selectionStart, scrollTop, scrollLeft } = this.area;
    this.base = text;
    this.conflict = null;
    if (this.area.value !== text) {
      this.area.value = text;
      this.area.setSelectionRange(selectionStart, selectionStart);
      Object.assign(this.area, { scrollTop, scrollLeft });
    }
    this.draw();
  }

  saved(text) {
    this.base = text;
    this.conflict = null;
    this.draw();
    this.note("saved");
  }

  reloadButton(text) {
    const button = document.createElement("button");
    button.textContent = "Take the file's text";
    button.addEventListener("click", () => {
      this.take(text);
      this.note("");
    });
    this.state.append(" ", button);
  }

  note(text) {
    this.state.textContent = text;
  }

  mark(errors) {
    this.errors = errors.filter((error) => error.line);
    this.draw();
  }

  // Put the caret where a mistake or a rule stands.
  jump(line, column = 1) {
    const lines = this.area.value.split("\n");
    const start = lines.slice(0, line - 1).reduce((n, l) => n + l.length + 1, 0) + column - 1;
    this.area.focus();
    this.area.setSelectionRange(start, start + (lines[line - 1]?.length ?? 0) - column + 1);
    const height = this.area.scrollHeight / Math.max(lines.length, 1);
    this.area.scrollTop = Math.max(0, (line - 6) * height);
  }

  draw() {
    const text = this.area.value;
    const spans = pieces(text, this.words).map(([part, kind]) => {
      const span = document.createElement("span");
      span.className = kind;
      span.textContent = part;
      return span;
    });
    this.colours.replaceChildren(...spans, "\n");
    this.underline(text);
    this.state.dataset.changed = this.isChanged;
    if (this.isChanged && ["", "saved"].includes(this.state.textContent)) this.note("not saved");
    this.scroll();
  }

  // Mark the lines with mistakes in the gutter, and their characters by highlights of the browser.
  underline(text) {
    const wrong = new Map(this.errors.map((error) => [error.line, error]));
    const lines = text.split("\n");
    this.gutter.replaceChildren(
      ...lines.map((_, k) => {
        const mark = document.createElement("span");
        mark.textContent = `${k + 1}\n`;
        const error = wrong.get(k + 1);
        if (error) {
          mark.className = error.severity;
          mark.title = error.text;
        }
        return mark;
      }),
    );
    if (!globalThis.Highlight) return;
    const ranges = this.isChanged ? [] : this.errors.map((error) => this.rangeOf(error, lines)).filter(Boolean);
    CSS.highlights.set("mistakes", new Highlight(...ranges));
  }

  rangeOf(error, lines) {
    const offset = (line, column) => lines.slice(0, line - 1).reduce((n, l) => n + l.length + 1, 0) + column - 1;
    const start = offset(error.line, error.column);
    const end = Math.max(start + 1, offset(error.end_line, error.end_column));
    const range = new Range();
    const ends = [[start, "setStart"], [end, "setEnd"]];
    let at = 0;
    for (const span of this.colours.children) {
      const size = span.textContent.length;
      while (ends.length && ends[0][0] <= at + size) {
        const [place, set] = ends.shift();
        range[set](span.firstChild ?? span, place - at);
      }
      at += size;
    }
    return ends.length ? null : range;
  }

  scroll() {
    const { scrollTop, scrollLeft } = this.area;
    this.colours.style.transform = `translate(${-scrollLeft}px, ${-scrollTop}px)`;
    this.gutter.style.transform = `translateY(${-scrollTop}px)`;
  }
}
