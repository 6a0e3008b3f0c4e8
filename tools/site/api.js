// The studio's page without a server: the law runs here, and what the program made beforehand is fetched from beside it.
import { preview } from "./faults.js";
import { unpacked } from "./packed.js";
import PRESETS from "./presets.js";
import { heed } from "./words.js";

export class Problem extends Error {}

export const STATIC = true, PAUSE_MS = 1000;
const nameOf = (faults) => Object.keys(PRESETS).find((name) => JSON.stringify(PRESETS[name]) === JSON.stringify(faults));
export const mendable = () => true, beforehand = (faults) => nameOf(faults) !== undefined;
export const onAway = () => () => {};
export const ended = (job) => ["done", "failed", "cancelled"].includes(job?.state);
export const fileOf = (job, name) => `./plays/${job.id}/${name}`;

async function read(url) {
  const response = await fetch(url).catch(() => null);
  if (!response?.ok) throw new Problem("gone");
  return response;
}

// Faults of one's own are mended here, beside the page, by the program's kernels.
const own = new Map(), SHOWN = ["printed.bin", "mended.bin"];
let printer, count = 0, worker;
async function mend(id) {
  const one = own.get(id), part = await unzipped("./part").then((text) => new Response(text).json()), known = await read("./printer.json").then((response) => response.json());
  const [head, base] = await tables(`./plays/${known.base}/printed.bin`, [Uint16Array]); // what is wanted, and its beads, are the same
  worker ??= new Worker(new URL("./planner-worker.js", import.meta.url), { type: "module" });
  const made = await new Promise((done, failed) => { worker.onmessage = ({ data }) => done(data); worker.onerror = (event) => failed(new Problem(event.message)); worker.postMessage([one.faults, part, known, head.row]); });
  one.tables = { "printed.bin": [{ ...head, p95_mm: made.before.p95_mm }, base, made.raw], "mended.bin": [{ points: head.points, row: head.row, p95_mm: made.after.p95_mm }, made.mended] };
  return { id, kind: "play", state: "done", share: 1, step: "", files: SHOWN, error: null, result: { refused: null, said: null, before: made.before, after: made.after } };
}

export async function post(path, body) {
  if (path === "/play/preview") return preview(body, await (printer ??= read("./printer.json").then((response) => response.json())));
  if (path === "/play") {
    if (beforehand(body)) return { id: nameOf(body) };
    const id = `own-${++count}`;
    own.set(id, { faults: body });
    return { id };
  }
  throw new Problem("gone");
}
export const get = () => Promise.reject(new Problem("gone")), patch = get, remove = get, upload = get;

export function follow(key, told) {
  let here = true;
  if (own.has(key)) {
    told({ id: key, kind: "play", state: "running", share: 0.5, step: "mend", files: [], error: null });
    mend(key).then((job) => here && told(job), (error) => here && told({ id: key, state: "failed", error: error.message, files: [] }));
    return () => { here = false; };
  }
  read(`./plays/${key}/job.json`).then((response) => response.json()).then((job) => here && told(heed(job)), () => here && told({ id: key, state: "failed", error: "gone", files: [] }));
  return () => { here = false; };
}

// Packed by gzip under a name that no host unpacks by itself.
const unzipped = async (url) => { const { body } = await read(`${url}.packed`); return new Response(body.pipeThrough(new DecompressionStream("gzip"))).arrayBuffer(); };
export async function tables(url, kinds) {
  const [, id, name] = url.match(/plays\/(own-\d+)\/(.*)$/) ?? [];
  return id ? own.get(id).tables[name] : unpacked(await unzipped(url), kinds);
}
