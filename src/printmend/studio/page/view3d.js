// A part in three dimensions: beads as strips that face the eye and are shaded as if they were round, so that a segment
// costs two triangles. One uniform moves all points between wanted, as printed and mended. Drawn only when something changes.
import {
  BufferAttribute, BufferGeometry, Color, GLSL3, InstancedBufferGeometry, InstancedInterleavedBuffer,
  InterleavedBufferAttribute, LineBasicMaterial, LineSegments, Mesh, OrbitControls, PerspectiveCamera, RawShaderMaterial,
  Scene, Vector3, WebGLRenderer,
} from "./vendor.js";

const VERTEX = `
in vec3 position; in vec3 wantedA; in vec3 wantedB; in vec4 offA; in vec4 offB; in vec2 errA; in vec2 errB; in vec4 markA; in vec4 markB;
uniform mat4 modelViewMatrix, projectionMatrix;
uniform float morph, unit, enlarge, first, minimum;
out float across; out float err; out vec3 sideDir; out vec3 faceDir;
vec3 place(vec3 wanted, vec4 off) {
  vec2 by = morph <= 1.0 ? off.xy * morph : mix(off.xy, off.zw, morph - 1.0);
  return wanted + vec3(by * unit * enlarge, 0.0);
}
void main() {
  if (markA.x < 0.5 || float(gl_InstanceID) < first) { gl_Position = vec4(2.0, 2.0, 2.0, 1.0); return; }
  vec3 a = (modelViewMatrix * vec4(place(wantedA, offA), 1.0)).xyz;
  vec3 b = (modelViewMatrix * vec4(place(wantedB, offB), 1.0)).xyz;
  vec3 along = b - a;
  float size = length(along);
  along = size > 1e-6 ? along / size : vec3(1.0, 0.0, 0.0);
  vec3 here = position.x < 0.5 ? a : b;
  vec3 eye = normalize(-here);
  vec3 side = cross(along, eye);
  side = length(side) > 1e-4 ? normalize(side) : vec3(0.0, 1.0, 0.0);
  vec3 world = transpose(mat3(modelViewMatrix)) * side;
  vec2 bead = 0.005 * markB.yz;
  float half_ = max(length(vec2(length(world.xy) * bead.x, world.z * bead.y)), minimum * -here.z);
  here += along * (position.x - 0.5) * bead.x * 0.9 + side * position.y * half_;
  across = position.y;
  vec2 e = position.x < 0.5 ? errA : errB;
  err = (morph <= 1.0 ? e.x * morph : mix(e.x, e.y, morph - 1.0)) * 0.001;
  sideDir = side;
  faceDir = normalize(cross(side, along)) * sign(dot(cross(side, along), eye) + 1e-9);
  gl_Position = projectionMatrix * vec4(here, 1.0);
}`;
const FRAGMENT = `
precision highp float;
in float across; in float err; in vec3 sideDir; in vec3 faceDir;
uniform float most, tinted; uniform vec3 plain; out vec4 colour;
vec3 ramp(float t) {
  vec3 a = vec3(0.184, 0.561, 0.514), b = vec3(0.914, 0.769, 0.416), c = vec3(0.906, 0.435, 0.318), d = vec3(0.608, 0.133, 0.149);
  return t < 0.45 ? mix(a, b, t / 0.45) : t < 0.72 ? mix(b, c, (t - 0.45) / 0.27) : mix(c, d, clamp((t - 0.72) / 0.28, 0.0, 1.0));
}
void main() {
  float rise = sqrt(max(0.0, 1.0 - across * across));
  vec3 normal = normalize(sideDir * across + faceDir * rise);
  float light = 0.42 + 0.5 * max(dot(normal, normalize(vec3(-0.35, 0.65, 0.7))), 0.0) + 0.14 * max(dot(normal, normalize(vec3(0.7, 0.1, 0.5))), 0.0);
  vec3 base = tinted > 0.5 ? ramp(clamp(err / most, 0.0, 1.0)) : plain;
  colour = vec4(base * light * mix(0.8, 1.06, rise), 1.0);
}`;
const COARSE = { gpu: 700000, cpu: 10000 }; // segments that are turned without a jerk

export class View {
  constructor(canvas, { onFrame = () => {} } = {}) {
    this.canvas = canvas;
    this.onFrame = onFrame;
    this.renderer = new WebGLRenderer({ canvas, antialias: !isSlow(), alpha: true, powerPreference: "high-performance" });
    this.slow = isSlow();
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
      morph: { value: 1 }, unit: { value: 0.002 }, enlarge: { value: 1 }, first: { value: 0 }, minimum: { value: 0.0004 },
      most: { value: 1 }, tinted: { value: 1 }, plain: { value: new Color("#9aa7a5") },
    };
    this.material = new RawShaderMaterial({ glslVersion: GLSL3, vertexShader: VERTEX, fragmentShader: FRAGMENT, uniforms: this.uniforms, side: 2 });
    this.seen = new ResizeObserver(() => this.resize());
    this.seen.observe(canvas);
    this.resize();
  }

  // Draw coarsely until nothing has changed for a moment.
  glance() {
    this.moving = true;
    clearTimeout(this.still);
    this.still = setTimeout(() => { this.moving = false; this.draw(); }, this.slow ? 1200 : 300);
    this.draw();
  }

  // Without a graphics card a fine picture takes the processor from the work that goes on: until it is done, a coarse one.
  wait(busy) {
    this.busy = busy;
    this.draw();
  }

  // Show a part; keeps the eye where it is if the part is the same.
  show(part, bed) {
    const fresh = !this.part || this.part.points !== part.points || this.part.low_mm.some((v, i) => Math.abs(v - part.low_mm[i]) > 0.5);
    this.clear();
    this.part = part;
    this.uniforms.unit.value = part.unit_mm;
    this.fine = this.mesh(part.wanted, part.offsets, part.errors, part.marks);
    const limit = this.slow ? COARSE.cpu : COARSE.gpu;
    this.coarse = part.points > 1.3 * limit ? this.mesh(...thinned(part, limit)) : null;
    this.scene.add(this.fine);
    if (this.coarse) this.scene.add(this.coarse);
    this.floor = floor(bed ?? [part.low_mm[0] - 15, part.low_mm[1] - 15, part.high_mm[0] + 15, part.high_mm[1] + 15], part);
    this.scene.add(this.floor);
    this.layers(0, part.layers.length - 1);
    if (fresh) this.fit();
    this.glance();
  }

  mesh(wanted, offsets, errors, marks) {
    const geometry = new InstancedBufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(new Float32Array([0, -1, 0, 0, 1, 0, 1, -1, 0, 1, 1, 0]), 3));
    geometry.setIndex([0, 2, 1, 1, 2, 3]);
    for (const [name, array, stride] of [["wanted", wanted, 3], ["off", offsets, 4], ["err", errors, 2], ["mark", marks, 4]]) {
      const buffer = new InstancedInterleavedBuffer(array, stride, 1);
      geometry.setAttribute(`${name}A`, new InterleavedBufferAttribute(buffer, stride, 0));
      geometry.setAttribute(`${name}B`, new InterleavedBufferAttribute(buffer, stride, stride));
    }
    geometry.instanceCount = Math.max(0, wanted.length / 3 - 1);
    const mesh = new Mesh(geometry, this.material);
    mesh.frustumCulled = false;
    return mesh;
  }

  // Show the layers from `low` to `high`, counted from 0.
  layers(low, high) {
    const { part } = this;
    const end = high + 1 < part.layers.length ? part.layers[high + 1][1] : part.points;
    this.range = [part.layers[low]?.[1] ?? 0, Math.max(0, end - 1)];
    this.whole = low === 0 && high === part.layers.length - 1;
    this.draw();
  }

  set(values) {
    for (const [name, value] of Object.entries(values)) {
      if (name === "plain") this.uniforms.plain.value.set(value);
      else this.uniforms[name].value = value;
    }
    this.glance();
  }

  fit(from = [-0.5, -1, 0.72]) {
    const { low_mm: low, high_mm: high } = this.part;
    const middle = new Vector3(...low.map((v, i) => (v + high[i]) / 2));
    const size = Math.hypot(...low.map((v, i) => high[i] - v)) || 50;
    const narrow = Math.min(1, this.camera.aspect);
    this.controls.target.copy(middle);
    this.camera.position.copy(middle).addScaledVector(new Vector3(...from).normalize(), (size * 1.42) / narrow);
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

  draw() {
    if (this.waiting || this.gone) return;
    this.waiting = requestAnimationFrame(() => { this.waiting = 0; this.now(); });
  }

  now() {
    if (!this.part || this.gone) return;
    const begun = performance.now();
    const coarse = this.coarse && (this.moving || (this.busy && this.slow)) && this.whole;
    this.fine.visible = !coarse;
    if (this.coarse) this.coarse.visible = Boolean(coarse);
    this.uniforms.first.value = coarse ? 0 : this.range[0];
    this.fine.geometry.instanceCount = this.range[1];
    this.renderer.setPixelRatio(this.moving && this.slow ? Math.min(1, devicePixelRatio) : Math.min(2, devicePixelRatio));
    this.renderer.render(this.scene, this.camera);
    this.onFrame(performance.now() - begun, coarse);
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width || !height) return;
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.uniforms.minimum.value = 0.55 * Math.tan((this.camera.fov * Math.PI) / 360) / height * 2;
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  picture() {
    this.moving = false;
    this.now();
    return new Promise((done) => this.canvas.toBlob(done, "image/png"));
  }

  clear() {
    for (const mesh of [this.fine, this.coarse, this.floor]) {
      if (mesh) { this.scene.remove(mesh); mesh.geometry.dispose(); }
    }
  }

  close() {
    this.gone = true;
    cancelAnimationFrame(this.waiting);
    clearTimeout(this.still);
    this.seen.disconnect();
    this.canvas.removeEventListener("wheel", this.wheel);
    this.clear();
    this.controls.dispose();
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

// Whole layers only, evenly over the height, so that a turning part keeps its shape.
function thinned(part, limit) {
  const step = Math.ceil(part.points / limit), spans = [];
  part.layers.forEach(([, first], i) => {
    if (i % step === 0 || i === part.layers.length - 1) spans.push([first, part.layers[i + 1]?.[1] ?? part.points]);
  });
  const count = spans.reduce((sum, [a, b]) => sum + b - a, 0);
  return [["wanted", 3], ["offsets", 4], ["errors", 2], ["marks", 4]].map(([name, each]) => {
    const whole = part[name], out = new whole.constructor(count * each);
    let at = 0;
    for (const [a, b] of spans) { out.set(whole.subarray(a * each, b * each), at); at += (b - a) * each; }
    return out;
  });
}

function floor([x0, y0, x1, y1], part) {
  const z = Math.min(0, part.low_mm[2]), points = [];
  for (let x = Math.ceil(x0 / 10) * 10; x <= x1; x += 10) points.push(x, y0, z, x, y1, z);
  for (let y = Math.ceil(y0 / 10) * 10; y <= y1; y += 10) points.push(x0, y, z, x1, y, z);
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(points), 3));
  return new LineSegments(geometry, new LineBasicMaterial({ color: 0x8b8780, transparent: true, opacity: 0.28 }));
}
