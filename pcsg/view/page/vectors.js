// Vectors of three numbers, and the camera that they make. World frame: right-handed, z up.

export const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const mul = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0],
];
export const size = (a) => Math.hypot(...a);
export const unit = (a) => mul(a, 1 / size(a));

// Turn a vector about a unit axis by an angle.
export function turn(v, axis, angle) {
  const c = Math.cos(angle), s = Math.sin(angle);
  return add(add(mul(v, c), mul(cross(axis, v), s)), mul(axis, dot(axis, v) * (1 - c)));
}

// The unit vectors right, up and forward of a camera.
export function axes(camera) {
  const forward = unit(sub(camera.target, camera.eye));
  let right = cross(forward, camera.up);
  if (size(right) < 1e-9 * size(camera.up)) right = cross(forward, Math.abs(forward[0]) < 0.5 ? [1, 0, 0] : [0, 1, 0]);
  right = unit(right);
  return { right, up: cross(right, forward), forward };
}

// Height of the picture in world units: at the distance 1, or anywhere if orthographic.
export function tall(camera) {
  const tangent = 2 * Math.tan((camera.fov * Math.PI) / 360);
  if (camera.projection !== "orthographic") return tangent;
  return camera.height ?? tangent * size(sub(camera.target, camera.eye));
}

// Origin and unit direction of the ray through a place of the picture, from (0, 0) top left to
// (1, 1), as `pcsg/render/camera.py` has them.
export function ray(camera, place, aspect) {
  const { right, up, forward } = axes(camera);
  const x = (2 * place[0] - 1) * aspect, y = 1 - 2 * place[1];
  const sum = (...parts) => parts.reduce((total, [length, axis]) => add(total, mul(axis, length)), [0, 0, 0]);
  const half = tall(camera) / 2, angle = (camera.fov * Math.PI) / 360;
  if (camera.projection === "orthographic") return { origin: add(camera.eye, sum([x * half, right], [y * half, up])), direction: forward };
  let direction;
  if (camera.projection === "fisheye") {
    const off = Math.hypot(x, y) * angle, side = off ? (Math.sin(off) / off) * angle : angle;
    direction = sum([Math.cos(off), forward], [side * x, right], [side * y, up]);
  } else if (camera.projection === "panorama") {
    const upward = unit(camera.up), level = cross(upward, right), flat = Math.cos(y * angle);
    direction = sum([flat * Math.cos(x * angle), level], [flat * Math.sin(x * angle), right], [Math.sin(y * angle), upward]);
  } else direction = sum([1, forward], [x * half, right], [y * half, up]);
  return { origin: camera.eye, direction: unit(direction) };
}
