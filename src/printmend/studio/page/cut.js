// A cut through the part: every bead where it lies, as wide and as high as it is.
import { html, useEffect, useMemo, useState } from "./vendor.js";
import { Save } from "./drawings.js";
import { useLook, Zoom } from "./look.js";
import { beadOf, errorOf, heightOf, placeOf, shareOf } from "./scene.js";
import { number, t } from "./words.js";

const SHADES = 40, WINDOW_MM = 9;
const RAMP = [[0, [38, 70, 120]], [0.5, [47, 143, 131]], [0.725, [233, 196, 106]], [0.86, [231, 111, 81]], [1, [155, 34, 38]]]; // as in view3d.js
export function ramp(share) {
  const k = Math.max(1, RAMP.findIndex(([at]) => share <= at)), [a, from] = RAMP[k - 1], [b, to] = RAMP[k];
  return from.map((v, i) => Math.round(v + ((to[i] - v) * (share - a)) / (b - a)));
}
const shade = (share) => `rgb(${ramp(share).join(" ")})`;

// Where the plane cuts beads: [from, to, top, height, error mm] each, along the cut. `across` is the axis that the plane
// stands across, 0 or 1, `at` where it stands. A bead covers what lies within half its width of its line.
export function beads(scene, morph, across, at) {
  const along = 1 - across, found = [], place = placeOf(scene, morph), error = errorOf(scene, morph);
  let last = -2, v1 = 0, fresh = true;
  for (let i = 0; i + 1 < scene.points; i++) {
    const bead = beadOf(scene, i);
    if (!bead) { fresh = true; continue; }
    const v0 = fresh ? place(i, across) : v1, r = bead[0] / 2;
    v1 = place(i + 1, across);
    fresh = false;
    if ((v0 < at - r && v1 < at - r) || (v0 > at + r && v1 > at + r)) continue;
    const u0 = place(i, along), u1 = place(i + 1, along), size = Math.hypot(u1 - u0, v1 - v0);
    let low = Infinity, high = -Infinity;
    const take = (u) => { low = Math.min(low, u); high = Math.max(high, u); };
    for (const [u, v] of [[u0, v0], [u1, v1]]) {
      const off = Math.abs(at - v);
      if (off <= r) { const half = Math.sqrt(r * r - off * off); take(u - half); take(u + half); }
    }
    if (size > 0) for (const side of [-r, r]) {
      const a = v0 + (side * (u1 - u0)) / size, b = v1 + (side * (u1 - u0)) / size, u = u0 - (side * (v1 - v0)) / size;
      if (a !== b && (a - at) * (b - at) <= 0) take(u + ((u1 - u0) * (at - a)) / (b - a));
    }
    if (low > high) continue;
    const off = error(i + 1), before = found.at(-1);
    if (last === i - 1 && low <= before[1] && high >= before[0]) { before[0] = Math.min(before[0], low); before[1] = Math.max(before[1], high); before[4] = Math.max(before[4], off); }
    else found.push([low, high, heightOf(scene, i + 1), bead[1], off]);
    last = i;
  }
  return found;
}

const bar = ([low, high, top, height]) => {
  const r = Math.min(height, high - low) / 2, y = [-top, -top + height].map((v) => v.toFixed(3)), [a, b] = [low + r, high - r].map((v) => v.toFixed(3));
  return `M${a} ${y[0]}H${b}A${r.toFixed(3)} ${(height / 2).toFixed(3)} 0 0 1 ${b} ${y[1]}H${a}A${r.toFixed(3)} ${(height / 2).toFixed(3)} 0 0 1 ${a} ${y[0]}`;
};

export function Cut({ scene, morph, scale, name }) {
  const [across, setAcross] = useState(1), { low_mm: low, high_mm: high } = scene, middle = (axis) => (low[axis] + high[axis]) / 2;
  const [at, setAt] = useState(middle(1)), along = 1 - across;
  const whole = [low[along] - 2, -high[2] - 2, high[along] - low[along] + 4, high[2] + 4];
  const cut = useMemo(() => beads(scene, morph, across, at), [scene, morph, across, at]), wanted = useMemo(() => beads(scene, 0, across, at), [scene, across, at]);
  const near = (rows) => { // the wall at the left end of the cut, half way up: a skirt is lower
    const half = high[2] / 2, level = rows.filter((row) => Math.abs(row[2] - half) < WINDOW_MM / 4), left = (level.length ? level : rows).reduce((least, row) => Math.min(least, row[0]), Infinity);
    return [(Number.isFinite(left) ? left : whole[0]) - 1, Math.min(0.5, -half + WINDOW_MM / 4) - WINDOW_MM / 2, WINDOW_MM, WINDOW_MM / 2];
  };
  const { box, setBox, zoom, props } = useLook(whole, near(wanted));
  useEffect(() => { setBox(near(wanted)); }, [scene, across]);
  const seen = (row) => row[1] > box[0] - box[2] && row[0] < box[0] + 2 * box[2] && -row[2] < box[1] + 2 * box[3] && -row[2] + row[3] > box[1] - box[3];
  const shades = Array.from({ length: SHADES }, () => "");
  for (const row of cut) if (seen(row)) shades[morph <= 0.02 ? 0 : Math.min(SHADES - 1, Math.floor(shareOf(row[4], scale) * SHADES))] += bar(row);
  const size = box[2] / 90;
  return html`<section class="card stack" data-testid="cut"><div class="row between"><h3>${t("cut")}</h3><div class="row"><div class="segment" role="group" aria-label=${t("cut")}>${[1, 0].map((axis) => html`<button aria-pressed=${axis === across} onClick=${() => { setAcross(axis); setAt(middle(axis)); }}>${t("cut_along", { axis: "XY"[1 - axis] })}</button>`)}</div>
      <button class="quiet" onClick=${() => setBox(whole)}>${t("cut_whole")}</button><button class="quiet" onClick=${() => setBox(near(cut))}>${t("cut_wall")}</button></div></div>
    <label class="field"><span>${t("cut_at", { axis: "XY"[across] })}<span class="value">${number(at, 1)} mm</span></span><input type="range" min=${low[across]} max=${high[across]} step="0.1" value=${at} onInput=${(event) => setAt(Number(event.target.value))} /></label>
    <div class="stage low"><svg id="cut" class="fill" ...${props} role="img" aria-label=${t("cut_says", { n: cut.length, axis: "XY"[across], at: number(at, 1) })}>
        ${shades.map((path, i) => path && html`<path d=${path} fill=${morph <= 0.02 ? "var(--wanted)" : shade((i + 0.5) / SHADES)} stroke="var(--card)" stroke-width="0.6" vector-effect="non-scaling-stroke" />`)}
        <path d=${wanted.filter(seen).map(bar).join("")} class="w" stroke="var(--ink)" stroke-width="1" stroke-dasharray="3 3" />
        <g transform=${`translate(${box[0] + box[2] * 0.03} ${box[1] + box[3] * 0.96})`}><path d=${`M0 0H1M0 ${-size}V${size}M1 ${-size}V${size}`} stroke="var(--ink)" stroke-width="1.4" fill="none" vector-effect="non-scaling-stroke" /><text x="0.5" y=${-size * 1.4} text-anchor="middle" style=${{ fontSize: `${size * 2.2}px` }}>1 mm</text></g></svg>
      <div class="over"><span></span><div class="row"><${Zoom} zoom=${zoom} /><${Save} id="cut" name=${`${name}-cut`} /></div></div></div>
    <p class="faint">${t("cut_key")}${cut.length ? "" : ` ${t("cut_none")}`}</p></section>`;
}
