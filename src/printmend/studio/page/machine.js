// The printer as a simple machine, seen obliquely from the front: frame, bed, gantry, belts, pulleys and screw, by its
// kinematics and the size of its bed. Faults are drawn larger. Hover or focus on a part lights it, and what is said of it.
import { html, useEffect, useState } from "./vendor.js";
import { once } from "./motion.js";
import { number, t } from "./words.js";

const DEEP = [0.5, 0.4]; // how far a millimetre of depth goes to the right and up
const flat = ([x, y, z]) => [x + DEEP[0] * y, -z - DEEP[1] * y];
// A plane through `at`, whose first axis is x or y, and whose second is x, y or z, as a transformation of SVG.
const ALONG = { x: [1, 0], y: [DEEP[0], -DEEP[1]], z: [0, -1] };
const plane = (at, first, second) => `matrix(${[...ALONG[first], ...ALONG[second], ...flat(at)].join(" ")})`;
const path = (points) => points.map(([x, y], i) => `${i ? "L" : "M"}${x.toFixed(2)} ${y.toFixed(2)}`).join("");
const line = (...points) => path(points.map(flat));

const PLAYED_MS = 4200, ROUND = 48;
// From 0 to 1 once for each `key`; 0 where nothing may move.
function useOnce(key) {
  const [phase, setPhase] = useState(0);
  useEffect(() => (key ? once(PLAYED_MS, (share) => setPhase(share < 1 ? share : 0)) : undefined), [key]);
  return phase;
}

// There and back: how far the motor went, how far the carriage, and which span hangs, from −1 (the upper) to 1.
// The carriage stands until the motor has taken up the play (physics.md, eq. 3).
function gone(phase, travel, play) {
  const motor = (travel * (1 - Math.cos(2 * Math.PI * phase))) / 2;
  const carriage = phase <= 0 ? play / 2 : phase < 0.5 ? Math.max(play / 2, motor - play / 2) : Math.min(travel - play / 2, motor + play / 2);
  return [motor, carriage, play > 0 ? Math.max(-1, Math.min(1, (motor - carriage) / (play / 2))) : 1];
}

const round = (radius) => Array.from({ length: ROUND }, (_, i) => [radius * Math.cos((2 * Math.PI * i) / ROUND), radius * Math.sin((2 * Math.PI * i) / ROUND)]);
const grown = (outline, radius, larger) => outline.map(([x, y]) => { const r = Math.hypot(x, y) || 1, to = radius + (r - radius) * larger; return [(x / r) * to, (y / r) * to]; });
// A pulley made so much larger than this would no longer look like one: then it says its own factor.
const most = ({ outline_mm: outline, radius_mm: radius }) => { const off = outline ? Math.max(...outline.map(([x, y]) => Math.abs(Math.hypot(x, y) - radius))) : 0; return Math.max(1, Math.floor((0.4 * radius) / Math.max(off, 1e-9))); };

// How much of a belt's play is drawn: so much that one sees it, and no more than there is room for.
const drawn = (motor, size, larger) => (motor.play_mm > 0.01 ? Math.min(size * 1.5, size * 0.4 + motor.play_mm * larger * 3) : 0);

// A pulley in its plane, turned by what its motor went.
function Wheel({ motor, size, turned, larger }) {
  const { outline_mm: outline, radius_mm: radius = 1 } = motor, factor = Math.min(larger, most({ ...motor, radius_mm: radius }));
  return html`<g><circle r=${size} class="hole" /><circle r=${size} class="ring" /><g transform=${`rotate(${(turned / size) * (180 / Math.PI)})`}><path d=${path(outline ? grown(outline, radius, factor).map((p) => p.map((v) => (v * size) / radius)) : round(size)) + "Z"} class="wheel" /><path d=${`M0 0H${size * 0.7}`} class="axle" /></g><circle r=${size * 0.14} class="axle" /></g>`;
}

// A belt around a motor's pulley at 0 and an idler at `length`; a span hangs by what it has of play.
function Belt({ motor, size, length, larger, phase, clamp = true }) {
  const play = drawn(motor, size, larger), travel = length * 0.55, [went, carriage, side] = gone(phase, travel, play);
  const span = (w, share, out) => `M0 ${w}Q${length / 2} ${w + out * share * play} ${length} ${w}`;
  return html`<g><path d=${span(size, (1 - side) / 2, -1) + span(-size, (1 + side) / 2, -1)} class="belt" /><g transform=${`translate(${length} 0)`}><circle r=${size} class="idler" /></g>
    <${Wheel} motor=${motor} size=${size} turned=${-went} larger=${larger} />${clamp && html`<rect x=${length * 0.2 + carriage - size * 0.55} y=${size * 0.45} width=${size * 1.1} height=${size * 1.1} rx=${size * 0.2} class="clamp" />`}</g>`;
}

// `lit` is the part that is lit, `light` hears which one should be; `faults` are those that have a fault. Played once for
// each `played`: the pulleys turn there and back, the belts take up their slack.
export function Machine({ machine, larger = 1, label, faults = [], lit, light, played, id = "machine", small = false }) {
  const phase = useOnce(played), [x0, y0, x1, y1] = machine.bed_mm, w = x1 - x0, d = y1 - y0, core = machine.kinematics === "corexy", h = Math.max(w, d) * (core ? 0.62 : 0.6);
  const size = Math.min(w, d) * 0.07, [one, two] = machine.motors ?? [{}, {}], screw = machine.screw, names = core ? ["a", "b"] : ["x", "y"];
  const part = (name, drawn, says) => html`<g class=${`mpart ${faults.includes(name) ? "bad" : ""} ${lit === name ? "lit" : ""}`} ...${light ? { tabindex: 0, role: "button", "aria-label": says, "data-part": name, onMouseEnter: () => light(name), onMouseLeave: () => light(null), onFocus: () => light(name), onBlur: () => light(null) } : {}}>${drawn}</g>`;
  const at = (i) => { const [a, b] = machine.net_mm[i], [c, e] = machine.bent_mm[i]; return flat([a + (c - a) * larger - x0, b + (e - b) * larger - y0, 0]); };
  let net = "";
  for (let first = 0; machine.net_mm && first < machine.net_mm.length; first += machine.along) net += path(Array.from({ length: machine.along }, (_, i) => at(first + i)));
  const gy = d * 0.55, gz = core ? h * 0.86 : h * 0.5, side = w * 0.09, [, carriage] = gone(phase, (w + side) * 0.55, drawn(one, size, larger)), cx = w * (phase ? 0.14 : 0.42) + (phase ? carriage : 0);
  const pushed = screw ? Math.min(larger * 3, Math.max(1, Math.floor((size * 1.6) / Math.max(...screw.push_mm.map(([x]) => Math.abs(x)), 1e-9)))) : 1;
  const rod = (x, y) => screw ? path(screw.at_mm.map((z, i) => flat([x + screw.push_mm[i][0] * pushed, y + screw.push_mm[i][1] * pushed, (z / screw.at_mm.at(-1)) * h]))) : line([x, y, 0], [x, y, h]);
  const turns = (x, y) => Array.from({ length: 22 }, (_, i) => line([x - size * 0.28, y, (h * (i + 0.4)) / 22], [x + size * 0.28, y, (h * (i + 0.75)) / 22])).join("");
  const zx = core ? w * 0.5 : w + side, zy = core ? d * 1.08 : gy;
  const bed = html`<path d=${line([0, 0, 0], [w, 0, 0], [w, d, 0], [0, d, 0]) + "Z"} class="bed" />`;
  const frame = part("frame", html`${core ? html`<path d=${line([-side, -side, 0], [w + side, -side, 0], [w + side, d + side, 0], [-side, d + side, 0]) + "Z" + line([-side, -side, h], [w + side, -side, h], [w + side, d + side, h], [-side, d + side, h]) + "Z" + [[-side, -side], [w + side, -side], [w + side, d + side], [-side, d + side]].map(([x, y]) => line([x, y, 0], [x, y, h])).join("")} class="beam" />`
      : html`<path d=${line([-side, gy, -h * 0.1], [-side, gy, h], [w + side, gy, h], [w + side, gy, -h * 0.1]) + line([-side, 0, -h * 0.1], [-side, d, -h * 0.1]) + line([w + side, 0, -h * 0.1], [w + side, d, -h * 0.1]) + line([-side, gy, -h * 0.1], [w + side, gy, -h * 0.1])} class="beam" />`}${bed}${net ? html`<path d=${net} class="net" />` : ""}`, t("mpart_frame"));
  const zed = part("z", html`<path d=${turns(zx, zy)} class="thread" /><path d=${rod(zx, zy)} class="rod" />`, t("mpart_z"));
  const belts = core ? html`${part(names[1], html`<${Loop} motor=${two} size=${size} w=${w} d=${d} z=${gz - size * 0.8} g=${gy} c=${cx} side=${side} far larger=${larger} phase=${phase} />`, t("motor", { name: "B" }))}
      ${part(names[0], html`<${Loop} motor=${one} size=${size} w=${w} d=${d} z=${gz} g=${gy} c=${cx} side=${side} larger=${larger} phase=${phase} />`, t("motor", { name: "A" }))}
      <path d=${line([0, gy, gz], [w, gy, gz])} class="gantry" />`
    : html`<path d=${line([-side, gy, gz - size * 1.9], [w + side, gy, gz - size * 1.9])} class="gantry" />${part(names[0], html`<g transform=${plane([-side * 0.4, gy, gz], "x", "z")}><${Belt} motor=${one} size=${size} length=${w + side * 0.8} larger=${larger} phase=${phase} clamp=${false} /></g>`, t("motor", { name: "X" }))}`;
  const head = html`<g transform=${`translate(${flat([cx, gy, gz - size * 1.6]).join(" ")})`}><rect x=${-size * 0.9} y=${-size * 0.9} width=${size * 1.8} height=${size * 2.2} rx=${size * 0.3} class="head" /><path d=${`M${-size * 0.5} ${size * 1.3}H${size * 0.5}L${size * 0.12} ${size * 2.2}H${-size * 0.12}Z`} class="tip" /></g>`;
  const yBelt = core ? "" : part(names[1], html`<g transform=${plane([w + side * 2.2, -size * 0.6, size], "y", "z")}><${Belt} motor=${two} size=${size} length=${d + size} larger=${larger} phase=${phase} /></g>`, t("motor", { name: "Y" }));
  const corners = [[-side * 1.4, -side * 1.2, -h * 0.14], [w + side * (core ? 1.6 : 2.4), d + side * 1.2, h * 1.04]].map(flat), pad = size * (small ? 0.6 : 1.6), box = [corners[0][0] - pad, corners[1][1] - pad, corners[1][0] - corners[0][0] + 2 * pad, corners[0][1] - corners[1][1] + 2 * pad];
  const named = (name, x, y, z, anchor = "middle") => { const [u, v] = flat([x, y, z]); return html`<text x=${u} y=${v} text-anchor=${anchor} style=${{ fontSize: `${size * 0.75}px`, fontWeight: 640 }}>${name}</text>`; };
  const factor = (motor) => { const own = Math.min(larger, most({ radius_mm: 1, ...motor })); return own < larger ? ` ${number(own, 0)} ×` : ""; };
  return html`<svg id=${id} class="fill machine" viewBox=${box.join(" ")} role=${light ? "group" : "img"} aria-label=${label}>${frame}${zed}${belts}${head}${yBelt}
    ${!small && html`<g aria-hidden="true">${core ? html`${named(`A${factor(one)}`, -side * 1.1, d + side * 1.9, gz)}${named(`B${factor(two)}`, w + side * 1.1, d + side * 1.9, gz)}` : html`${named(`X${factor(one)}`, -side * 0.75, gy, gz + size * 1.5, "start")}${named(`Y${factor(two)}`, w + side * 2.2, -size * 0.6, -size * 1.4)}`}${named(`Z${pushed > 1 ? ` ${number(pushed, 0)} ×` : ""}`, zx, zy, h + size * 0.7)}</g>`}</svg>`;
}

// One of a CoreXY's belts: from its motor at the back, along the back and a side to the gantry, across the carriage, and
// around the front corner back to the motor. `far` mirrors it.
function Loop({ motor, size, w, d, z, g, c, side, far = false, larger, phase }) {
  const x = (v) => (far ? w - v : v), play = drawn(motor, size, larger), [went, , hangs] = gone(phase, w * 0.5, play), out = side * 0.45;
  const corner = (px, py) => [x(px), py], at = far ? w - c : c;
  const places = [corner(-out, d), corner(w + out, d), corner(w + out, g), corner(at, g)], back = [corner(at, g - size), corner(-out, g - size), corner(-out, 0)];
  const sag = ((1 + hangs) / 2) * play, away = far ? 1 : -1;
  const from = back.at(-1), to = places[0];
  return html`<g transform=${plane([0, 0, z], "x", "y")}><path d=${path(places) + path(back) + `Q${from[0] + away * sag * 2} ${(from[1] + to[1]) / 2} ${to[0]} ${to[1]}`} class="belt" />${[places[1], places[2], back[1], back[2]].map(([px, py]) => html`<circle cx=${px} cy=${py} r=${size * 0.5} class="idler" />`)}
    <g transform=${`translate(${to[0]} ${to[1]})`}><${Wheel} motor=${motor} size=${size} turned=${far ? went : -went} larger=${larger} /></g></g>`;
}

// How much larger faults are drawn at first: less than ten times where the bed's net would leave its picture.
export function inside({ bed_mm: [x0, y0, x1, y1], net_mm: net, bent_mm: bent }) {
  const far = Math.max(...net.flatMap(([x, y], i) => [Math.abs(bent[i][0] - x), Math.abs(bent[i][1] - y)]), 1e-9);
  return Math.max(1, Math.min(10, Math.floor((0.08 * Math.min(x1 - x0, y1 - y0)) / far)));
}
