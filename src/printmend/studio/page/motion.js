// What moves once, by itself: nothing where the reader wants nothing to move.
export const still = () => matchMedia("(prefers-reduced-motion: reduce)").matches;

const LONGEST_FRAME_MS = 70; // a slower frame counts as this one: a busy computer shows all of it, later

// Run `step` with shares from 0 to 1 for so long, once; where nothing may move, with 1 alone. Returns how to stop it.
export function once(ms, step) {
  if (still()) { step(1); return () => {}; }
  let frame, before, gone = 0;
  const next = (now) => { gone += Math.min(now - (before ?? now), LONGEST_FRAME_MS); before = now; step(Math.min(1, gone / ms)); if (gone < ms) frame = requestAnimationFrame(next); };
  frame = requestAnimationFrame(next);
  return () => cancelAnimationFrame(frame);
}

export const ease = (share) => 1 - (1 - share) ** 3;
