// The picture of a scene in a notebook: turned and zoomed as on the page, over the notebook's own wire.

import { Hands } from "./hands.js";
import { Picture } from "./picture.js";

const LATE = 400; // milliseconds after which a picture while moving is not waited for

function render({ model, el }) {
  const canvas = document.createElement("canvas");
  Object.assign(canvas, { tabIndex: 0, width: model.get("width"), height: model.get("height") });
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", "Picture of the scene. Arrow keys turn it, plus and minus zoom.");
  Object.assign(canvas.style, { width: `${model.get("width")}px`, maxWidth: "100%", touchAction: "none", cursor: "grab", display: "block" });
  const status = document.createElement("div");
  status.setAttribute("role", "status");
  status.style.font = "12px/1.4 system-ui, sans-serif";
  el.append(canvas, status);

  const picture = new Picture(canvas);
  let camera = null, home = null, bounds = null, number = 0, awaited = 0, awaitedAt = 0, due = false, moving = false;
  const ask = () => {
    if (moving && awaited && performance.now() - awaitedAt < LATE) return void (due = true);
    due = false;
    awaited = ++number;
    awaitedAt = performance.now();
    model.send({ type: "want", camera: camera ?? {}, size: [model.get("width"), model.get("height")], samples: model.get("samples"), mode: model.get("mode") || null, moving, number });
  };
  const view = {
    picture,
    camera: () => camera ?? home,
    bounds: () => bounds,
    move(moved) { camera = moved; moving = true; ask(); },
    rest() { moving = false; ask(); },
    click() {},
  };
  new Hands(canvas, view);
  canvas.addEventListener("keydown", (event) => {
    if (event.key !== "r") return;
    camera = null;
    view.rest();
  });
  const heard = async (message, buffers) => {
    if (message.type === "scene") bounds = message.bounds;
    if (message.type === "errors") status.textContent = message.errors.map((error) => error.text).join("\n");
    if (message.type !== "frame") return;
    const [depth, data] = buffers.map((b) => new Uint8Array(b.buffer, b.byteOffset, b.byteLength).slice());
    message.depth = new Float32Array(depth.buffer);
    message.blob = new Blob([data], { type: message.kind });
    if (message.number >= awaited) awaited = 0;
    if (due) ask();
    if (message.own_camera) home = message.camera;
    await picture.show(message);
    status.textContent = message.done ? "" : "drawing";
  };
  model.on("msg:custom", heard);
  ask();
  return () => model.off("msg:custom", heard);
}

export default { render };
