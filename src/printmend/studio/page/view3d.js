// A part in three dimensions: beads as strips that face the eye and are shaded as if they were round, so that a segment
// costs two triangles. The card keeps the points as they were sent and looks them up by the number of the corner that it
// draws: no corner is stored. One uniform moves all points between wanted, as printed and mended. Drawn only when
// something changes; while it turns with as many layers as are drawn without a jerk, and then, in pieces that another
// turn may interrupt, with all of them.
import {
  BufferAttribute, BufferGeometry, Color, DataTexture, GLSL3, LineSegments, Mesh, OrbitControls, PerspectiveCamera,
  RawShaderMaterial, RGBAIntegerFormat, Scene, ShortType, UnsignedShortType, Vector3, WebGLRenderer,
} from "./vendor.js";

const ROW = 2048, CORNERS = 6; // points in a row of a table; of the two triangles of a segment
const VERTEX = `
precision highp float; precision highp int; precision highp usampler2D; precision highp isampler2D;
uniform usampler2D base; uniform isampler2D raw, mended;
uniform mat4 modelViewMatrix, projectionMatrix; uniform vec3 low, pitch;
uniform float morph, unit, enlarge, minimum; uniform vec2 doubt;
out float across; out float err; out vec3 sideDir; out vec3 faceDir; flat out int number;
vec3 off(ivec2 at) {
  vec3 by = vec3(texelFetch(raw, at, 0).xyz);
  return morph <= 1.0 ? by * morph : mix(by, vec3(texelFetch(mended, at, 0).xyz), morph - 1.0);
}
void main() {
  int segment = gl_VertexID / 6, corner = gl_VertexID - 6 * segment;
  corner = corner < 3 ? corner : corner == 3 ? 2 : corner == 4 ? 1 : 3;
  ivec2 atA = ivec2(segment % ROW, segment / ROW), atB = ivec2((segment + 1) % ROW, (segment + 1) / ROW);
  uvec4 rowA = texelFetch(base, atA, 0), rowB = texelFetch(base, atB, 0);
  number = segment;
  if ((rowA.w & 1u) == 0u) { gl_Position = vec4(2.0, 2.0, 2.0, 1.0); return; }
  vec3 offA = off(atA), offB = off(atB);
  vec3 a = (modelViewMatrix * vec4(low + pitch * vec3(rowA.xyz) + vec3(offA.xy * unit * enlarge, 0.0), 1.0)).xyz;
  vec3 b = (modelViewMatrix * vec4(low + pitch * vec3(rowB.xyz) + vec3(offB.xy * unit * enlarge, 0.0), 1.0)).xyz;
  vec3 along = b - a;
  float size = length(along);
  along = size > 1e-6 ? along / size : vec3(1.0, 0.0, 0.0);
  bool begins = corner < 2;
  vec3 here = begins ? a : b;
  across = (corner & 1) == 0 ? -1.0 : 1.0;
  vec3 eye = normalize(-here);
  vec3 side = cross(along, eye);
  side = length(side) > 1e-4 ? normalize(side) : vec3(0.0, 1.0, 0.0);
  vec3 world = transpose(mat3(modelViewMatrix)) * side;
  vec2 bead = 0.005 * vec2(float((rowA.w >> 1u) & 255u), float(rowA.w >> 9u));
  float half_ = max(length(vec2(length(world.xy) * bead.x, world.z * bead.y)), minimum * -here.z);
  here += along * (begins ? -0.45 : 0.45) * bead.x + side * across * half_;
  err = length(vec2((begins ? offA.z : offB.z) * 0.001, morph <= 1.0 ? morph * doubt.x : mix(doubt.x, doubt.y, morph - 1.0)));
  sideDir = side;
  faceDir = normalize(cross(side, along)) * sign(dot(cross(side, along), eye) + 1e-9);
  gl_Position = projectionMatrix * vec4(here, 1.0);
}`.replaceAll("ROW", ROW);
const FRAGMENT = `
precision highp float; precision highp int;
in float across; in float err; in vec3 sideDir; in vec3 faceDir; flat in int number;
uniform float most, fine, tinted; uniform bool counted; uniform vec3 plain; out vec4 colour;
vec3 ramp(float t) {
  vec3 z = vec3(0.149, 0.275, 0.471), a = vec3(0.184, 0.561, 0.514), b = vec3(0.914, 0.769, 0.416), c = vec3(0.906, 0.435, 0.318), d = vec3(0.608, 0.133, 0.149);
  return t < 0.5 ? mix(z, a, t / 0.5) : t < 0.725 ? mix(a, b, (t - 0.5) / 0.225) : t < 0.86 ? mix(b, c, (t - 0.725) / 0.135) : mix(c, d, clamp((t - 0.86) / 0.14, 0.0, 1.0));
}
void main() {
  if (counted) { colour = vec4(ivec4(number, number >> 8, number >> 16, 255) & 255) / 255.0; return; }
  float rise = sqrt(max(0.0, 1.0 - across * across));
  vec3 normal = normalize(sideDir * across + faceDir * rise);
  float light = 0.42 + 0.5 * max(dot(normal, normalize(vec3(-0.35, 0.65, 0.7))), 0.0) + 0.14 * max(dot(normal, normalize(vec3(0.7, 0.1, 0.5))), 0.0);
  vec3 base = tinted > 0.5 ? ramp(err < fine ? 0.5 * err / fine : 0.5 + 0.5 * clamp((err - fine) / (most - fine), 0.0, 1.0)) : plain;
  colour = vec4(base * light * mix(0.8, 1.06, rise), 1.0);
}`;
const FLOOR = {
  vertexShader: "precision highp float; in vec3 position; uniform mat4 modelViewMatrix, projectionMatrix; void main() { gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }",
  fragmentShader: "precision highp float; out vec4 colour; void main() { colour = vec4(0.153, 0.149, 0.137, 0.28); }", // of premultiplied alpha
};
// Of a picture while it turns: how long it may take, and how many segments may be drawn in it to begin with. Without a
// graphics card a fine picture is drawn in pieces of so many segments.
const JERK_MS = 110, FIRST = { gpu: 1e9, cpu: 12000 }, LEAST = 4000, PIECE = 25000;
const ROOM = 1.06; // so much larger than the part's box the picture is

export class View {
  constructor(canvas, { onFrame = () => {} } = {}) {
    this.canvas = canvas;
    this.onFrame = onFrame;
    this.slow = isSlow();
    this.rest = [];
    this.step = 1;
    this.budget = this.slow ? FIRST.cpu : FIRST.gpu;
    // fine pieces are drawn over the coarse picture, which therefore stays
    this.renderer = new WebGLRenderer({ canvas, antialias: !this.slow, alpha: true, powerPreference: "high-performance", preserveDrawingBuffer: this.slow });
    this.renderer.sortObjects = false;
    this.renderer.autoClear = false;
    this.gl = this.renderer.getContext();
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(32, 1, 1, 5000);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.addEventListener("change", () => this.draw());
    this.controls.addEventListener("start", () => { this.moving = true; this.draw(); });
    this.controls.addEventListener("end", () => { this.moving = false; this.draw(); });
    this.wheel = () => this.glance();
    canvas.addEventListener("wheel", this.wheel, { passive: true });
    this.uniforms = {
      morph: { value: 1 }, unit: { value: 0.002 }, enlarge: { value: 1 }, minimum: { value: 0.0004 }, most: { value: 1 }, fine: { value: 0 }, doubt: { value: [0, 0] }, tinted: { value: 1 },
      plain: { value: new Color("#9aa7a5") }, low: { value: new Vector3() }, pitch: { value: new Vector3() }, counted: { value: false },
      base: { value: null }, raw: { value: null }, mended: { value: null },
    };
    this.material = new RawShaderMaterial({ glslVersion: GLSL3, vertexShader: VERTEX, fragmentShader: FRAGMENT, uniforms: this.uniforms, side: 2 });
    this.beads = new Mesh(new BufferGeometry(), [this.material]);
    this.beads.frustumCulled = false;
    this.scene.add(this.beads);
    this.warm();
    this.seen = new ResizeObserver(() => this.resize());
    this.seen.observe(canvas);
    this.resize();
  }

  // Draw a part that cannot be seen: what a first picture takes, compiling above all, is then done before there is one.
  warm() {
    const points = new Uint16Array(4 * ROW);
    this.part = { points: 2, layers: [[0, 0, 0]], low_mm: [0, 0, 0], high_mm: [1, 1, 1], step_mm: [1, 1, 1] };
    this.uniforms.base.value = table(points, "RGBA16UI", UnsignedShortType);
    this.uniforms.raw.value = this.uniforms.mended.value = table(new Int16Array(points), "RGBA16I", ShortType);
    this.range = [0, 0];
    this.render(this.spans(1));
    this.gl.deleteSync(this.sync);
    this.sync = this.part = null;
  }

  // Draw coarsely until nothing has changed for a moment.
  glance() {
    this.moving = true;
    clearTimeout(this.still);
    this.still = setTimeout(() => { this.moving = false; this.draw(); }, 300);
    this.draw();
  }

  // Without a graphics card a fine picture takes the processor from the work that goes on: until it is done, a coarse one.
  wait(busy) {
    this.busy = busy;
    this.draw();
  }

  // Show a part; keeps the eye where it is if the part is the same.
  show(part, bed) {
    const fresh = !this.part || this.part.of !== part.of;
    this.clear();
    this.part = part;
    this.uniforms.unit.value = part.unit_mm;
    this.uniforms.low.value.set(...part.low_mm);
    this.uniforms.pitch.value.set(...part.step_mm);
    this.uniforms.base.value = table(part.base, "RGBA16UI", UnsignedShortType);
    this.uniforms.raw.value = table(part.raw, "RGBA16I", ShortType);
    this.uniforms.mended.value = part.mended ? table(part.mended, "RGBA16I", ShortType) : this.uniforms.raw.value;
    this.floor = floor(bed ?? [part.low_mm[0] - 15, part.low_mm[1] - 15, part.high_mm[0] + 15, part.high_mm[1] + 15], part);
    this.scene.add(this.floor);
    this.layers(0, part.layers.length - 1);
    if (fresh) this.fit();
    this.glance();
  }

  // Show nothing.
  empty() {
    this.clear();
    this.part = null;
    this.rest = [];
    this.renderer.clear();
  }

  // Show the layers from `low` to `high`, counted from 0.
  layers(low, high) {
    this.range = [low, high];
    this.draw();
  }

  // The segments [first, count] of every `step`-th layer that is shown, the lowest, the highest and the light ones always.
  spans(step) {
    const { layers, points } = this.part, [low, high] = this.range, light = points / layers.length / step, found = [];
    for (let i = low; i <= high && i < layers.length; i++) {
      const first = layers[i][1], end = layers[i + 1]?.[1] ?? points, before = found.at(-1);
      if ((i - low) % step && i !== high && end - first > light) continue;
      if (before && before[0] + before[1] === first) before[1] += end - first;
      else found.push([first, end - first]);
    }
    const last = found.at(-1);
    if (last && last[0] + last[1] === points) last[1] -= 1; // nothing leads on from the last point
    return found;
  }

  // Look at the height `z` as before at the middle.
  aim(z) {
    const by = z - this.controls.target.z;
    this.controls.target.z += by;
    this.camera.position.z += by;
    this.controls.update();
  }

  set(values) {
    for (const [name, value] of Object.entries(values)) {
      if (name === "plain") this.uniforms.plain.value.set(value);
      else this.uniforms[name].value = value;
    }
    this.glance();
  }

  // Look along `from` at the middle of the part, as near as its box allows.
  fit(from = this.part.from ?? [-0.5, -1, 0.72]) {
    const { low_mm: low, high_mm: high } = this.part, { aspect, fov } = this.camera, steep = Math.tan((fov * Math.PI) / 360);
    const middle = new Vector3(...low.map((v, i) => (v + high[i]) / 2)), size = Math.hypot(...low.map((v, i) => high[i] - v)) || 50;
    const back = new Vector3(...from).normalize(), right = new Vector3(0, 0, 1).cross(back).normalize(), up = back.clone().cross(right);
    let away = size / 20;
    for (let corner = 0; corner < 8; corner++) {
      const at = new Vector3(...low.map((v, i) => (corner >> i & 1 ? high[i] : v))).sub(middle);
      away = Math.max(away, at.dot(back) + (ROOM * Math.max(Math.abs(at.dot(right)) / aspect, Math.abs(at.dot(up)))) / steep);
    }
    this.controls.target.copy(middle);
    this.camera.position.copy(middle).addScaledVector(back, away);
    this.camera.near = size / 60;
    this.camera.far = size * 12;
    this.camera.updateProjectionMatrix();
    this.controls.update();
  }

  // Turn by angles in rad, come nearer by a factor: for the keyboard.
  turn(right, up, nearer = 1) {
    const away = this.camera.position.clone().sub(this.controls.target);
    let around = Math.atan2(away.y, away.x) + right;
    const flat = Math.hypot(away.x, away.y), size = away.length() / nearer;
    const tilt = Math.min(1.55, Math.max(-1.55, Math.atan2(away.z, flat) + up));
    this.camera.position.set(Math.cos(around) * Math.cos(tilt), Math.sin(around) * Math.cos(tilt), Math.sin(tilt)).multiplyScalar(size).add(this.controls.target);
    this.controls.update();
    this.glance();
  }

  // Draw soon: one picture at a time, however fast things change.
  draw() {
    this.stale = true;
    this.soon();
  }

  soon() {
    if (!this.waiting && !this.gone) this.waiting = requestAnimationFrame(() => { this.waiting = 0; this.next(); });
  }

  next() {
    if (!this.part || this.gone) return;
    if (this.sync && this.gl.clientWaitSync(this.sync, 0, 0) === this.gl.TIMEOUT_EXPIRED) { this.soon(); return; }
    if (this.sync) this.drawn();
    if (this.stale) this.begin();
    else if (this.rest.length) this.render(this.rest.shift());
    else return;
    this.soon();
  }

  // What was drawn last is on the screen: was it quick enough?
  drawn() {
    const took = performance.now() - this.begun;
    this.gl.deleteSync(this.sync);
    this.sync = null;
    if (this.moving && this.coarse && took > JERK_MS) this.budget = Math.max(LEAST, 0.7 * Math.min(this.budget, this.count));
    else if (this.moving && this.step > 1 && took < JERK_MS / 3) this.budget *= 1.4;
    this.onFrame(took, !this.stale && !this.rest.length && !(this.step > 1));
  }

  // Begin a picture: coarse where all of it would take too long, with the rest to come as soon as nothing moves.
  begin() {
    const all = this.spans(1), total = all.reduce((sum, [, count]) => sum + count, 0), hold = this.moving || (this.busy && this.slow);
    const step = hold || this.slow ? Math.ceil(total / this.budget) : 1;
    this.coarse = hold;
    const ratio = Math.min(this.slow && this.moving ? 1 : 2, devicePixelRatio);
    if (ratio !== this.renderer.getPixelRatio()) this.renderer.setPixelRatio(ratio);
    this.whole(step);
    if (hold || step === 1) return;
    for (const [first, count] of all) for (let at = 0; at < count; at += PIECE) this.rest.push([[first + at, Math.min(PIECE, count - at)]]);
    this.rest.reverse(); // from the top: what lies below is then hidden, and costs less
    this.step = 1;
  }

  render(spans) {
    const { geometry } = this.beads;
    geometry.clearGroups();
    this.count = 0;
    for (const [first, count] of spans) { geometry.addGroup(first * CORNERS, count * CORNERS, 0); this.count += count; }
    this.begun = performance.now();
    this.paint();
    if (this.sync) this.gl.deleteSync(this.sync);
    this.sync = this.gl.fenceSync(this.gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    this.gl.flush();
  }

  // Left of `wipe`, a share of the width, the part is as it prints, right of it mended.
  paint() {
    if (!(this.wipe > 0 && this.wipe < 1)) { this.renderer.render(this.scene, this.camera); return; }
    const { clientWidth: width, clientHeight: height } = this.canvas, { morph } = this.uniforms, kept = morph.value, at = Math.round(this.wipe * width);
    this.renderer.setScissorTest(true);
    for (const [value, left, wide] of [[1, 0, at], [2, at, width - at]]) {
      morph.value = value;
      this.renderer.setScissor(left, 0, wide, height);
      this.renderer.render(this.scene, this.camera);
    }
    morph.value = kept;
    this.renderer.setScissorTest(false);
  }

  // Show a wipe at this share of the width; null shows none.
  wipeAt(share) {
    if (this.wipe === share) return;
    this.wipe = share;
    if (this.part) this.glance();
  }

  // Pictures of the whole part as it prints and mended, `width` × `height` dots, seen from where one looks now.
  shots(width, height) {
    const { wipe, camera, controls, uniforms: { morph } } = this, kept = morph.value, [eye, target] = [camera.position.clone(), controls.target.clone()];
    this.wipe = null; // until both are drawn nothing else may run: the wipe may still be moving
    this.renderer.setPixelRatio(1);
    this.size(width, height);
    this.fit(eye.clone().sub(target).toArray());
    const found = [1, 2].map((value) => { morph.value = value; return this.picture(); });
    this.wipe = wipe;
    morph.value = kept;
    camera.position.copy(eye);
    controls.target.copy(target);
    controls.update();
    this.resize();
    return Promise.all(found);
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width || !height) return;
    this.size(width, height);
    this.draw();
  }

  size(width, height) {
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.uniforms.minimum.value = 0.55 * Math.tan((this.camera.fov * Math.PI) / 360) / height * 2;
    this.camera.updateProjectionMatrix();
  }

  // Draw every `step`-th layer now, on the floor.
  whole(step = 1) {
    this.stale = false;
    this.rest = [];
    this.step = step;
    this.renderer.clear();
    this.floor.visible = true;
    this.render(this.spans(step));
    this.floor.visible = false;
  }

  picture() {
    this.whole();
    return new Promise((done) => this.canvas.toBlob(done, "image/png"));
  }

  clear() {
    for (const name of ["base", "raw", "mended"]) this.uniforms[name].value?.dispose();
    if (this.floor) { this.scene.remove(this.floor); this.floor.geometry.dispose(); this.floor.material.dispose(); this.floor = null; }
  }

  close() {
    this.gone = true;
    cancelAnimationFrame(this.waiting);
    clearTimeout(this.still);
    this.seen.disconnect();
    this.canvas.removeEventListener("wheel", this.wheel);
    this.clear();
    this.controls.dispose();
    this.beads.geometry.dispose();
    this.material.dispose();
    this.renderer.dispose();
  }
}

let slow;
function isSlow() {
  if (slow === undefined) {
    const gl = document.createElement("canvas").getContext("webgl2");
    const info = gl?.getExtension("WEBGL_debug_renderer_info");
    slow = !gl || /swiftshader|llvmpipe|software|basic render/i.test(gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
    gl?.getExtension("WEBGL_lose_context")?.loseContext();
  }
  return slow;
}

function table(data, internalFormat, type) {
  const texture = new DataTexture(data, ROW, data.length / (4 * ROW), RGBAIntegerFormat, type);
  texture.internalFormat = internalFormat;
  texture.needsUpdate = true;
  return texture;
}

function floor([x0, y0, x1, y1], part) {
  const z = Math.min(0, part.low_mm[2]), points = [];
  for (let x = Math.ceil(x0 / 10) * 10; x <= x1; x += 10) points.push(x, y0, z, x, y1, z);
  for (let y = Math.ceil(y0 / 10) * 10; y <= y1; y += 10) points.push(x0, y, z, x1, y, z);
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(points), 3));
  return new LineSegments(geometry, new RawShaderMaterial({ glslVersion: GLSL3, ...FLOOR, transparent: true, premultipliedAlpha: true }));
}
