// The canvas: pictures as they come, and what is where in the one that is shown.

import { add, mul, ray } from "./vectors.js";

const REACH = 8; // cells around the pointer in which something is looked for
const MOST_PIXELS = 1_500_000; // finer screens get larger pixels

export class Picture {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.shown = null; // what is said about the picture that is seen
    this.order = 0;
    this.latest = 0;
  }

  // Width and height that pictures should have, in pixels.
  wantedSize() {
    const box = this.canvas.getBoundingClientRect();
    const dense = Math.min(window.devicePixelRatio || 1, 2);
    const scale = Math.min(1, Math.sqrt(MOST_PIXELS / Math.max(box.width * box.height * dense * dense, 1)));
    return [box.width, box.height].map((side) => Math.max(16, Math.round(side * dense * scale)));
  }

  async show(head) {
    const order = ++this.order;
    const bitmap = await createImageBitmap(head.blob);
    if (order < this.latest) return false; // a later one was decoded first
    this.latest = order;
    const [width, height] = head.size;
    if (this.canvas.width !== width || this.canvas.height !== height) {
      this.canvas.width = width;
      this.canvas.height = height;
    }
    this.context.imageSmoothingQuality = "medium";
    this.context.drawImage(bitmap, 0, 0, width, height);
    bitmap.close();
    this.shown = head;
    return true;
  }

  // What is at a place of the picture that is seen, or else nearest to it: where that is in the
  // picture, and its distance from the eye; null where nothing is near.
  find(place) {
    if (!this.shown) return null;
    const { depth, grid: [columns, rows] } = this.shown;
    const column = Math.min(columns - 1, Math.max(0, Math.floor(place[0] * columns)));
    const row = Math.min(rows - 1, Math.max(0, Math.floor(place[1] * rows)));
    const own = depth[row * columns + column];
    if (Number.isFinite(own)) return { place, distance: own };
    let best = null, nearest = (REACH + 1) ** 2;
    for (let y = Math.max(0, row - REACH); y <= Math.min(rows - 1, row + REACH); y++)
      for (let x = Math.max(0, column - REACH); x <= Math.min(columns - 1, column + REACH); x++) {
        const apart = (x - column) ** 2 + (y - row) ** 2, distance = depth[y * columns + x];
        if (!Number.isFinite(distance) || apart >= nearest) continue;
        nearest = apart;
        best = { place: [(x + 0.5) / columns, (y + 0.5) / rows], distance };
      }
    return best;
  }

  // The point of the world at a place of the picture that is seen; beside everything one as far
  // away as the target.
  point(place) {
    const { camera, size: [width, height] } = this.shown;
    const far = Math.hypot(...camera.target.map((t, k) => t - camera.eye[k]));
    const found = this.find(place) ?? { place, distance: far };
    const { origin, direction } = ray(camera, found.place, width / height);
    return add(origin, mul(direction, found.distance));
  }
}
