// The three-dimensional view as lines: the beads that can be seen from here, each as wide as it looks, the far ones first.
import { Vector3, WebGLRenderTarget } from "./vendor.js";
import { ramp } from "./cut.js";
import { beadOf, errorOf, heightOf, placeOf, shareOf } from "./scene.js";

const MOST_PX = 2400;
const LIGHTS = [[0.5, new Vector3(-0.35, 0.65, 0.7).normalize()], [0.14, new Vector3(0.7, 0.1, 0.5).normalize()]]; // as in view3d.js

// The numbers of the segments that are in front of all others somewhere in a picture `width` × `height`.
function visible(view, width, height) {
  const { renderer, uniforms } = view, target = new WebGLRenderTarget(width, height), pixels = new Uint8Array(4 * width * height), found = new Set();
  const { wipe } = view;
  view.wipe = null;
  uniforms.counted.value = true;
  view.floor.visible = false;
  renderer.setRenderTarget(target);
  renderer.clear();
  view.render(view.spans(1));
  renderer.readRenderTargetPixels(target, 0, 0, width, height, pixels);
  renderer.setRenderTarget(null);
  uniforms.counted.value = false;
  view.wipe = wipe;
  target.dispose();
  for (let at = 0; at < pixels.length; at += 4) if (pixels[at + 3]) found.add(pixels[at] | (pixels[at + 1] << 8) | (pixels[at + 2] << 16));
  return found;
}

export function vector(view) {
  const { camera, part, canvas, uniforms } = view, { clientWidth: width, clientHeight: height } = canvas;
  const finer = Math.min(2, MOST_PX / Math.max(width, height)), seen = visible(view, Math.round(width * finer), Math.round(height * finer));
  const morph = uniforms.morph.value, enlarge = uniforms.enlarge.value, place = placeOf(part, morph), wanted = placeOf(part, 0), error = errorOf(part, morph);
  const spot = (i) => new Vector3(...[0, 1].map((axis) => wanted(i, axis) + (place(i, axis) - wanted(i, axis)) * enlarge), heightOf(part, i));
  const flat = (at) => { const { x, y } = at.clone().project(camera); return `${(((x + 1) / 2) * width).toFixed(1)} ${(((1 - y) / 2) * height).toFixed(1)}`; };
  const plain = `#${uniforms.plain.value.getHexString()}`.match(/\w\w/g).map((two) => parseInt(two, 16)), near = Math.tan((camera.fov * Math.PI) / 360);
  const lines = [...seen].map((i) => {
    const a = spot(i), b = spot(i + 1), eye = camera.position.clone().sub(a), far = eye.length(), along = b.clone().sub(a).normalize();
    const side = along.clone().cross(eye).normalize(), face = side.clone().cross(along).normalize(), [wide, high] = beadOf(part, i);
    if (face.dot(eye) < 0) face.negate();
    face.transformDirection(camera.matrixWorldInverse);
    const light = 1.06 * LIGHTS.reduce((sum, [share, from]) => sum + share * Math.max(face.dot(from), 0), 0.42);
    const base = uniforms.tinted.value > 0.5 ? ramp(shareOf(error(i + 1), { most: uniforms.most.value, fine: uniforms.fine.value })) : plain;
    const stroke = (Math.hypot(Math.hypot(side.x, side.y) * wide, side.z * high) * height) / (2 * near * far);
    return [far, `<path d="M${flat(a)}L${flat(b)}" stroke="rgb(${base.map((v) => Math.min(255, Math.round(v * light))).join(" ")})" stroke-width="${Math.max(0.3, stroke).toFixed(2)}"/>`];
  }).sort(([one], [other]) => other - one);
  const grid = [], at = view.floor.geometry.attributes.position, inside = (v) => camera.position.clone().sub(v).dot(camera.position.clone().sub(view.controls.target)) > 0;
  for (let i = 0; i + 1 < at.count; i += 2) {
    const [a, b] = [0, 1].map((k) => new Vector3().fromBufferAttribute(at, i + k));
    if (inside(a) && inside(b)) grid.push(`M${flat(a)}L${flat(b)}`);
  }
  const paper = getComputedStyle(canvas.parentElement).backgroundColor;
  view.draw();
  return `<svg xmlns="http://www.w3.org/2000/svg" width="${width}" height="${height}" viewBox="0 0 ${width} ${height}" fill="none" stroke-linecap="round"><rect width="${width}" height="${height}" fill="${paper}"/><path d="${grid.join("")}" stroke="#8b8780" stroke-opacity="0.28" stroke-width="1"/>${lines.map(([, line]) => line).join("")}</svg>`;
}
