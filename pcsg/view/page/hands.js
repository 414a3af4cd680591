// Mouse, fingers and keys on the picture, made into steps of the camera.

import { fly, frame, orbit, slide, VIEWS, zoom } from "./camera.js";
import { size, sub } from "./vectors.js";

const TURN = 0.008; // radians for a pixel
const CLICK = 4; // pixels that a click may move
const STEP = 0.06; // radians for an arrow key

export class Hands {
  // `view` has `picture`, `camera()`, `move(camera)`, `rest()`, `bounds()`, `reset()`, `click(place)`.
  constructor(canvas, view) {
    this.canvas = canvas;
    this.view = view;
    this.fingers = new Map();
    this.keys = new Set();
    canvas.addEventListener("pointerdown", (e) => this.press(e));
    canvas.addEventListener("pointermove", (e) => this.drag(e));
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (e) => this.release(e));
    canvas.addEventListener("wheel", (e) => this.wheel(e), { passive: false });
    canvas.addEventListener("contextmenu", (e) => e.preventDefault());
    canvas.addEventListener("keydown", (e) => this.key(e));
    canvas.addEventListener("keyup", (e) => this.keys.delete(e.code));
    canvas.addEventListener("blur", () => this.keys.clear());
  }

  place(event) {
    const box = this.canvas.getBoundingClientRect();
    const inside = (v) => Math.min(1, Math.max(0, v));
    return [inside((event.clientX - box.left) / box.width), inside((event.clientY - box.top) / box.height)];
  }

  press(event) {
    this.canvas.focus();
    if (!this.view.picture.shown) return;
    this.canvas.setPointerCapture(event.pointerId);
    this.fingers.set(event.pointerId, [event.clientX, event.clientY]);
    const place = this.place(event);
    this.start = [event.clientX, event.clientY];
    this.moved = false;
    this.pivot = this.view.picture.point(place);
    this.far = size(sub(this.pivot, this.view.camera().eye));
    this.slides = event.button !== 0 || event.shiftKey;
  }

  drag(event) {
    const before = this.fingers.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY];
    if (!this.moved && Math.hypot(now[0] - this.start[0], now[1] - this.start[1]) < CLICK) return;
    this.moved = true;
    const height = this.canvas.clientHeight, camera = this.view.camera();
    const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
    if (this.fingers.size === 2) this.pinch(event.pointerId, before, now, camera, height);
    else if (this.slides) this.view.move(slide(camera, this.far, dx / height, dy / height));
    else this.view.move(orbit(camera, this.pivot, -dx * TURN, -dy * TURN));
    this.fingers.set(event.pointerId, now);
  }

  pinch(finger, before, now, camera, height) {
    const other = [...this.fingers].find(([id]) => id !== finger)[1];
    const apart = (p) => Math.max(Math.hypot(p[0] - other[0], p[1] - other[1]), 1);
    const slid = slide(camera, this.far, (now[0] - before[0]) / 2 / height, (now[1] - before[1]) / 2 / height);
    const factor = apart(before) / apart(now);
    this.far *= factor;
    this.view.move(zoom(slid, this.pivot, factor));
  }

  release(event) {
    if (!this.fingers.delete(event.pointerId)) return;
    if (this.moved) this.view.rest();
    else if (event.type === "pointerup" && event.button === 0) this.view.click(this.place(event), event.shiftKey);
  }

  wheel(event) {
    event.preventDefault();
    if (!this.view.picture.shown) return;
    const lines = event.deltaMode === 0 ? event.deltaY / 100 : event.deltaY / 3;
    const factor = Math.exp(0.18 * Math.max(-4, Math.min(4, lines)));
    this.view.move(zoom(this.view.camera(), this.view.picture.point(this.place(event)), factor));
    clearTimeout(this.pause);
    this.pause = setTimeout(() => this.view.rest(), 200);
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || !this.view.picture.shown) return;
    const camera = this.view.camera(), picture = this.view.picture;
    const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    const middle = () => picture.point([0.5, 0.5]);
    let moved = null;
    if (arrows && event.shiftKey) moved = slide(camera, size(sub(middle(), camera.eye)), -arrows[0] * 0.04, -arrows[1] * 0.04);
    else if (arrows) moved = orbit(camera, middle(), -arrows[0] * STEP, -arrows[1] * STEP);
    else if (event.key === "+" || event.key === "=") moved = zoom(camera, middle(), 0.83);
    else if (event.key === "-") moved = zoom(camera, middle(), 1 / 0.83);
    else if (event.key in VIEWS && this.view.bounds()) moved = frame(camera, this.view.bounds(), VIEWS[event.key]);
    else if (["KeyW", "KeyA", "KeyS", "KeyD", "KeyQ", "KeyE"].includes(event.code)) {
      this.keys.add(event.code);
      if (this.keys.size === 1) this.glide(performance.now());
    } else return;
    event.preventDefault();
    if (moved) {
      this.view.move(moved);
      clearTimeout(this.pause);
      this.pause = setTimeout(() => this.view.rest(), 250);
    }
  }

  // Fly as long as a key is down: a second takes the way to what is in the middle, nearly.
  glide(before) {
    requestAnimationFrame((now) => {
      if (this.keys.size === 0) return this.view.rest();
      const camera = this.view.camera();
      const far = this.view.picture.find([0.5, 0.5])?.distance ?? size(sub(camera.target, camera.eye));
      const by = 0.8 * far * Math.min(0.1, (now - before) / 1000);
      const on = (plus, minus) => (this.keys.has(plus) - this.keys.has(minus)) * by;
      this.view.move(fly(camera, on("KeyD", "KeyA"), on("KeyE", "KeyQ"), on("KeyW", "KeyS")));
      this.glide(now);
    });
  }
}
