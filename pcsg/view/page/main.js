// The page: what is wanted, and who shows what comes.

import { Answers } from "./answers.js";
import { frame } from "./camera.js";
import { commandOf, copy, settingOf } from "./command.js";
import { Curves } from "./curves.js";
import { Errors } from "./errors.js";
import { Hands } from "./hands.js";
import { Link } from "./link.js";
import { Picture } from "./picture.js";
import { Sheet } from "./sheet.js";
import { Sliders } from "./sliders.js";
import { TextPane } from "./text.js";

const $ = (id) => document.getElementById(id);
const LATE = 250; // milliseconds after which a picture while moving is not waited for
const YOUNG = 7; // years of a tree that follows a hand
const KEPT = "wanted";
const kept = JSON.parse(sessionStorage.getItem(KEPT) ?? "null");
const wanted = { values: {}, camera: null, mode: null, layer: "picture", samples: 16, ...kept };

let number = 0, awaited = 0, awaitedAt = 0, moving = false, due = false;
let scene = null, home = null, file = "", figures = "", counts = "";

const say = (text) => text !== $("status").textContent && ($("status").textContent = text);
const become = (state) => (document.body.dataset.state = state);

const showFigures = () => ($("figures").textContent = figures + counts);

// Ask for the picture that is wanted. While something moves one is under way at a time, so that a
// slow connection gets fewer pictures and no queue.
function ask(instead = {}) {
  if (moving && awaited && performance.now() - awaitedAt < LATE) {
    due = true;
    return;
  }
  due = false;
  awaited = ++number;
  awaitedAt = performance.now();
  sessionStorage.setItem(KEPT, JSON.stringify({ values: wanted.values, camera: wanted.camera, mode: wanted.mode }));
  const values = { ...wanted.values, ...instead };
  link.send({ type: "want", ...wanted, values, camera: wanted.camera ?? {}, size: picture.wantedSize(), moving, number });
}

const picture = new Picture($("picture"));
const pane = new TextPane($("text-pane"), (text, base) => link.send({ type: "save", text, base }));
const showLine = (line, column) => {
  openText(true);
  pane.jump(line, column);
};
const errors = new Errors($("errors"), (error) => showLine(error.line, error.column));
const answers = new Answers($("answers"), showLine);
const sliders = new Sliders($("parameters"), (values, isMoving, plays) => {
  wanted.values = values;
  // A tree is seen to grow only if the camera stands still.
  if (plays === "t" && scene.grown) wanted.camera ??= { ...home, ...scene.grown };
  moving = isMoving;
  ask();
});

const sheet = new Sheet($("sheet"), {
  ask: (name, steps, size) => link.send({ type: "sheet", name, steps, ...wanted, camera: wanted.camera ?? {}, size }),
  take(name, value) {
    wanted.values = { ...wanted.values, [name]: value };
    sliders.set(wanted.values);
    view.rest();
  },
  close: () => view.rest(),
});

const curves = new Curves($("curves"), {
  text: () => pane.area.value,
  // A draft is shown before it is saved. While a hand moves, the tree is a young one.
  draft(text, isMoving) {
    pane.area.value = text;
    pane.draw();
    link.send({ type: "draft", text });
    const age = wanted.values.t ?? scene.own.t;
    moving = isMoving;
    ask(isMoving ? { t: Math.min(age, YOUNG) } : {});
  },
  save: () => pane.store(),
  download: (text) => heard.file({ blob: new Blob([text]), name: file.replace(/^.*\//, "").replace(/(\.json)?$/, ".json") }),
});

const view = {
  picture,
  camera: () => wanted.camera ?? home,
  bounds: () => scene?.bounds,
  move(camera) {
    wanted.camera = camera;
    moving = true;
    ask();
  },
  rest() {
    moving = false;
    ask();
  },
  reset() {
    wanted.camera = null;
    this.rest();
  },
  frame() {
    if (!scene?.bounds || !this.camera()) return;
    wanted.camera = frame(this.camera(), scene.bounds);
    this.rest();
  },
  click([x, y]) {
    const { camera, size } = picture.shown;
    link.send({ type: "ask", x, y, camera, size });
  },
};
new Hands($("picture"), view);

const heard = {
  welcome(message) {
    if (!kept && Object.keys(wanted.values).length === 0) wanted.values = message.values;
    pane.words = new Set(message.words);
    file = message.file;
    ask();
  },
  text(message) {
    document.title = `${message.name} · pcsg view`;
    $("name").textContent = message.name;
    pane.show(message.text, message.trouble ?? (message.shipped ? "came with pcsg; it stays as it is" : ""));
    if (message.trouble) say(message.trouble);
  },
  saved(message) {
    pane.saved(message.text);
  },
  unsaved(message) {
    pane.note(`not saved: ${message.errors[0].message}`);
  },
  preparing(message) {
    become("preparing");
    const share = message.share === null ? "" : ` ${Math.round(100 * message.share)} %`;
    say(message.compiling ? "compiling kernels, which are kept: half a minute or so" : `preparing the scene${share}`);
    $("stop").disabled = false;
  },
  scene(message) {
    scene = message;
    counts = "";
    sliders.show(scene, wanted.values);
    curves.show(scene.curves);
    errors.show(message.warnings);
    pane.mark(message.warnings);
    become("drawing");
  },
  errors(message) {
    errors.show(message.errors);
    pane.mark(message.errors);
    $("stop").disabled = true;
    become("errors");
    say(message.errors.length === 1 ? "there is a mistake" : `there are ${message.errors.length} mistakes`);
  },
  trouble(message) {
    errors.show(message.errors);
  },
  tile: (message) => sheet.show(message),
  counts(message) {
    counts = ` · ${message.primitives} primitives · ${message.memory}`;
    showFigures();
  },
  answer: (message) => answers.show(message),
  async frame(message) {
    if (message.number >= awaited) awaited = 0;
    if (due) ask();
    if (message.own_camera) home = message.camera;
    if (!(await picture.show(message))) return;
    const rate = message.rays / Math.max(message.seconds, 1e-6) / 1e6;
    const samples = message.samples ? ` · ${message.samples.toPrecision(3)} samples` : "";
    figures = `${rate.toPrecision(2)} million rays/s${samples}`;
    showFigures();
    document.body.dataset.frames = Number(document.body.dataset.frames ?? 0) + 1;
    if (document.body.dataset.state === "errors") return;
    $("stop").disabled = message.done;
    become(message.done ? "done" : "drawing");
    say(message.done ? "done" : "drawing");
  },
  file(message) {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(message.blob);
    link.download = message.name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    say(`saved ${message.name}`);
  },
};

const link = new Link(
  (message) => heard[message.type]?.(message),
  (state, text) => {
    become(state);
    say(text);
    awaited = 0;
  },
);

function openText(open) {
  $("text-pane").hidden = !open;
  $("toggle-text").setAttribute("aria-pressed", String(open));
  if (open) pane.draw();
}

async function tell(text, what) {
  say((await copy(text)) ? `copied ${what}` : "the browser lets no page copy");
}

$("mode").value = wanted.mode ?? "";
$("mode").addEventListener("change", (e) => {
  wanted.mode = e.target.value || null;
  view.rest();
});
$("layer").addEventListener("change", (e) => {
  wanted.layer = e.target.value;
  view.rest();
});
$("frame").addEventListener("click", () => view.frame());
$("open-sheet").addEventListener("click", () => scene && sheet.open(sliders.ranges()));
$("reset").addEventListener("click", () => view.reset());
$("stop").addEventListener("click", () => link.send({ type: "stop" }));
$("toggle-text").addEventListener("click", () => openText($("text-pane").hidden));
$("help-open").addEventListener("click", () => $("help").showModal());
$("copy").addEventListener("click", () => tell(commandOf(file, wanted, picture.wantedSize()), "the command"));
$("copy-camera").addEventListener("click", () => view.camera() && tell(settingOf(view.camera()), "camera { ... } for the grammar"));
$("save-picture").addEventListener("click", () => {
  say("the picture is saved when it is done");
  link.send({ type: "file" });
});
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches("input, textarea, select")) return;
  const act = {
    f: () => view.frame(),
    r: () => view.reset(),
    t: () => openText($("text-pane").hidden),
    "?": () => $("help").showModal(),
  }[event.key];
  if (!act) return;
  event.preventDefault();
  act();
});
let resized;
new ResizeObserver(() => {
  clearTimeout(resized);
  resized = setTimeout(() => picture.shown && view.rest(), 120);
}).observe($("stage"));
