// What hands do to a camera: turn, slide, zoom, fly. Every function returns a new one.

import { add, axes, cross, dot, mul, size, sub, tall, turn, unit } from "./vectors.js";

const STEEPEST = (89.5 * Math.PI) / 180;

// Turn eye and target about a point, by angles sideways and upwards.
export function orbit(camera, pivot, sideways, upwards) {
  const up = unit(camera.up);
  const { right, forward } = axes(camera);
  const now = Math.asin(Math.max(-1, Math.min(1, dot(forward, up))));
  const then = Math.max(-STEEPEST, Math.min(STEEPEST, now + upwards));
  const move = (p) => add(pivot, turn(turn(sub(p, pivot), right, then - now), up, sideways));
  return { ...camera, eye: move(camera.eye), target: move(camera.target) };
}

// Slide by shares of the picture's height, so that what is at a distance follows the hand.
export function slide(camera, distance, right, up) {
  const a = axes(camera);
  const scale = tall(camera) * (camera.projection === "orthographic" ? 1 : distance);
  const by = add(mul(a.right, -right * scale), mul(a.up, up * scale));
  return { ...camera, eye: add(camera.eye, by), target: add(camera.target, by) };
}

// Go towards a point: it stays where it is in the picture, however far this goes.
export function zoom(camera, point, factor) {
  const move = (p) => add(point, mul(sub(p, point), factor));
  const eye = move(camera.eye), target = move(camera.target);
  // At the end of double precision eye and target fall together.
  const scale = Math.max(size(eye), 1e-300);
  if (!(size(sub(target, eye)) > 1e-14 * scale)) return camera;
  return { ...camera, eye, target, height: camera.height && camera.height * factor };
}

// Move by lengths to the right, up and ahead.
export function fly(camera, right, up, ahead) {
  const a = axes(camera);
  const by = add(add(mul(a.right, right), mul(a.up, up)), mul(a.forward, ahead));
  return { ...camera, eye: add(camera.eye, by), target: add(camera.target, by) };
}

// See a box from a direction (towards the eye); the direction stays if there is none.
export function frame(camera, bounds, from) {
  const centre = mul(add(bounds[0], bounds[1]), 0.5);
  const radius = Math.max(size(sub(bounds[1], bounds[0])) / 2, 1e-300);
  const towards = unit(from ?? sub(camera.eye, camera.target));
  const distance = radius / Math.sin((Math.min(camera.fov, 100) * Math.PI) / 360);
  const up = size(cross(towards, [0, 0, 1])) < 1e-6 ? [0, 1, 0] : [0, 0, 1];
  const height = camera.height && 2 * radius;
  return { ...camera, height, target: centre, eye: add(centre, mul(towards, distance)), up: from ? up : camera.up };
}

export const VIEWS = {
  1: [0, -1, 0], 2: [1, 0, 0], 3: [0, 1, 0], 4: [-1, 0, 0], 5: [0, 0, 1], 6: [0, 0, -1], 7: [-0.43, -0.8, 0.42],
};

const numbers = (v) => v.map((x) => String(Number(x.toPrecision(12)))).join(",");

// The text that `--camera` takes. At the end of precision all digits count.
export function toText(camera) {
  const near = size(sub(camera.target, camera.eye)) < 1e-6 * size(camera.eye);
  const point = near ? (v) => v.join(",") : numbers;
  const up = camera.up.join() === "0,0,1" ? "" : ` up=${numbers(camera.up)}`;
  const other = camera.projection === "perspective" ? "" : ` projection=${camera.projection}`;
  const high = camera.height ? ` height=${camera.height}` : "";
  return `eye=${point(camera.eye)} target=${point(camera.target)}${up} fov=${Number(camera.fov.toPrecision(9))}${other}${high}`;
}
