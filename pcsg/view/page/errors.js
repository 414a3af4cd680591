// Mistakes, laid over the last good picture in the form that a terminal shows.

export class Errors {
  constructor(element, jump) {
    this.element = element;
    this.jump = jump;
  }

  show(errors) {
    this.element.replaceChildren(
      ...errors.map((error) => {
        const text = document.createElement("pre");
        text.textContent = error.text;
        if (!error.line) return text;
        const button = document.createElement("button");
        button.title = "Show this line in the text";
        button.append(text);
        button.addEventListener("click", () => this.jump(error));
        return button;
      }),
    );
    this.element.hidden = errors.length === 0;
  }
}
