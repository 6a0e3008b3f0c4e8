// The picture of a job's part: wanted and as printed, then mended over it.
import { useEffect, useMemo, useRef, useState } from "./vendor.js";
import { fileOf, PAUSE_MS, tables } from "./api.js";
import { nice } from "./words.js";

// Fetch what a job has of its picture: [the scene, null until there is something to show; why a job that is done shows none].
// What a job listed may be gone before it is fetched: it failed, was stopped, or begins again. Only of one that was done
// already when it was asked is this worth a word; while it goes on it is asked again.
export function useScene(job, from) {
  const [coarse, setCoarse] = useState(null), [wanted, setWanted] = useState(null), [mended, setMended] = useState(null), [problem, setProblem] = useState(null), state = useRef();
  state.current = job?.state;
  useEffect(() => setProblem(null), [job?.id]);
  const load = (name, kinds, set) => {
    useEffect(() => {
      set(null);
      if (!job?.files?.includes(name) || (name === "coarse.bin" && job.files.includes("printed.bin"))) return undefined;
      let asked = true;
      const look = async () => {
        while (asked && ["running", "done"].includes(state.current)) {
          const done = state.current === "done";
          try { const found = await tables(fileOf(job, name), kinds); if (asked) set(found); return; } catch (error) { if (done) { if (asked) setProblem(error.message); return; } }
          await new Promise((go) => setTimeout(go, PAUSE_MS));
        }
      };
      look();
      return () => { asked = false; };
    }, [job?.id, job?.files?.includes(name)]);
  };
  load("coarse.bin", [Uint16Array, Int16Array], setCoarse); // of a large part, until all of it is there
  load("printed.bin", [Uint16Array, Int16Array], setWanted);
  load("mended.bin", [Int16Array], setMended);
  const scene = useMemo(() => {
    if (!wanted && !coarse) return null;
    const [head, base, raw] = wanted ?? coarse;
    return { ...head, from, of: job?.id, base, raw, coarse: !wanted, mended: wanted ? mended?.[1] ?? null : null, left_mm: (wanted && mended?.[0].p95_mm) || 0, doubt: job?.result?.doubt_mm };
  }, [coarse, wanted, mended, job?.result?.doubt_mm?.join()]);
  return [scene, problem];
}

// Place [mm] of point `i` along `axis` 0 or 1, `morph` of the way from wanted over printed to mended.
export function placeOf({ base, low_mm: low, step_mm: step, raw, mended, unit_mm: unit }, morph) {
  const [r, m] = morph <= 1 ? [morph * unit, 0] : [(2 - morph) * unit, (morph - 1) * unit];
  return (i, axis) => low[axis] + base[4 * i + axis] * step[axis] + r * raw[4 * i + axis] + (m ? m * mended[4 * i + axis] : 0);
}

export const heightOf = ({ base, low_mm: low, step_mm: step }, i) => low[2] + base[4 * i + 2] * step[2];

// Its distance from the wanted path [mm], with what a prediction does not know of it as printed and mended: `doubt`.
export function errorOf({ raw, mended, doubt }, morph) {
  const [r, m] = morph <= 1 ? [morph, 0] : [2 - morph, morph - 1], open = doubt ? r * doubt[0] + m * doubt[1] : 0;
  return (i) => Math.hypot((r * raw[4 * i + 2] + (m ? m * mended[4 * i + 2] : 0)) / 1000, open);
}

// The scale of the colours [mm]: `most` at its end, and where there is something mended `fine` in its middle, so that what
// is left of the error does not look all the same.
export function scaleOf(scene) {
  const [before, after] = scene?.doubt ?? [0, 0], most = nice(Math.max(Math.hypot(scene?.p95_mm || 0, before), 0.01)), left = nice(Math.max(Math.hypot(scene?.left_mm || 0, after), 0.005));
  return { most, fine: scene?.mended && left < most / 2 ? left : 0 };
}

// Where on the ramp of colours an error lies; without a fine part only the ramp's second half is used.
export const shareOf = (error, { most, fine }) => (error < fine ? error / fine : 1 + Math.min(1, (error - fine) / (most - fine))) / 2;

// The bead that leads on from point `i`: [width, height] in mm; null where none does.
export const beadOf = ({ base }, i) => (base[4 * i + 3] & 1 ? [((base[4 * i + 3] >> 1) & 255) / 100, (base[4 * i + 3] >> 9) / 100] : null);
