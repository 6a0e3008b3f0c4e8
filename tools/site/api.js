// The studio's page without a server: the law runs here, and what the program made beforehand is fetched from beside it.
import { preview } from "./faults.js";
import { unpacked } from "./packed.js";
import PRESETS from "./presets.js";
import { heed } from "./words.js";

export class Problem extends Error {}

export const STATIC = true, PAUSE_MS = 1000;
const nameOf = (faults) => Object.keys(PRESETS).find((name) => JSON.stringify(PRESETS[name]) === JSON.stringify(faults));
export const mendable = (faults) => nameOf(faults) !== undefined;
export const onAway = () => () => {};
export const ended = (job) => ["done", "failed", "cancelled"].includes(job?.state);
export const fileOf = (job, name) => `./plays/${job.id}/${name}`;

async function read(url) {
  const response = await fetch(url).catch(() => null);
  if (!response?.ok) throw new Problem("gone");
  return response;
}

let printer;
export async function post(path, body) {
  if (path === "/play/preview") return preview(body, await (printer ??= read("./printer.json").then((response) => response.json())));
  if (path === "/play" && mendable(body)) return { id: nameOf(body) };
  throw new Problem("gone");
}
export const get = () => Promise.reject(new Problem("gone")), patch = get, remove = get, upload = get;

export function follow(key, told) {
  let here = true;
  read(`./plays/${key}/job.json`).then((response) => response.json()).then((job) => here && told(heed(job)), () => here && told({ id: key, state: "failed", error: "gone", files: [] }));
  return () => { here = false; };
}

// Packed by gzip under a name that no host unpacks by itself.
export async function tables(url, kinds) {
  const { body } = await read(`${url}.packed`);
  return unpacked(await new Response(body.pipeThrough(new DecompressionStream("gzip"))).arrayBuffer(), kinds);
}
