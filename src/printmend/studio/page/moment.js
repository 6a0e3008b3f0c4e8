// The moment after mending: a handle that wipes between as it prints and mended, and numbers that count down.
import { html, useEffect, useRef, useState } from "./vendor.js";
import { ease, once, still } from "./motion.js";
import { digits, mm, number, t } from "./words.js";

const SWEEP_MS = 1800, COUNT_MS = 1600, REST = 0.5;

// `at` is the share of the picture's width left of which the part is shown as it prints. It comes in from the right once.
export function Wipe({ at, onMove }) {
  const place = useRef();
  useEffect(() => once(SWEEP_MS, (share) => onMove(1 - (1 - REST) * ease(share))), []);
  const to = (event) => { const { left, width } = place.current.parentElement.getBoundingClientRect(); onMove(Math.min(1, Math.max(0, (event.clientX - left) / width))); };
  const key = (event) => {
    const next = { ArrowLeft: at - 0.04, ArrowRight: at + 0.04, Home: 0, End: 1 }[event.key];
    if (next !== undefined) { onMove(Math.min(1, Math.max(0, next))); event.preventDefault(); }
  };
  return html`<div class="wipe" ref=${place} style=${{ left: `${100 * at}%` }}><span class="wlabel left glass" style=${{ opacity: at > 0.16 ? 1 : 0 }}>${t("printed")}</span><span class="wlabel right glass" style=${{ opacity: at < 0.84 ? 1 : 0 }}>${t("mended")}</span>
    <button class="whandle" role="slider" aria-label=${t("wipe")} aria-valuemin="0" aria-valuemax="100" aria-valuenow=${Math.round(100 * at)} aria-valuetext=${t("wipe_at", { n: Math.round(100 * at) })} onKeyDown=${key}
      onPointerDown=${(event) => event.currentTarget.setPointerCapture(event.pointerId)} onPointerMove=${(event) => event.buttons && to(event)}>‹ ›</button></div>`;
}

// A number that counts from `from` down to `to`; who cannot see it, or wants nothing to move, has the last one at once.
export function Counting({ from, to, unit = "mm", show = mm, children }) {
  const [now, setNow] = useState(still() ? to : from);
  useEffect(() => once(COUNT_MS, (share) => setNow(share === 1 ? to : from * (to / from) ** ease(share))), [from, to]);
  return html`<div class="number"><b aria-hidden="true" data-still=${now === to}>${show(now)} <small>${unit}</small></b><span class="sr">${show(to)} ${unit}</span><span>${children}</span></div>`;
}

// How many times better, as whoever divides the numbers that are shown finds it.
export const gain = (before_mm, after_mm) => Number(before_mm.toFixed(digits(before_mm))) / Math.max(Number(after_mm.toFixed(digits(after_mm))), 0.001);
export const times = (value) => number(Number(value.toPrecision(2)), value < 10 ? 1 : 0);
