// Talking to the studio's server: everything goes to where this page came from.
import { unpacked } from "./packed.js";
import { heed } from "./words.js";

export class Problem extends Error {}

// A page without a server has another file of this name: it shows only what was made beforehand.
export const STATIC = false;
export const mendable = () => true, beforehand = () => false;

async function answer(response) {
  const body = response.status === 204 ? null : heed(await response.json().catch(() => null));
  if (!response.ok) throw new Problem(body?.error ?? `${response.status} ${response.statusText}`);
  return body;
}

// Whoever listens here hears true when the server does not answer, and false when it is back.
const listeners = new Set();
export const onAway = (told) => { listeners.add(told); return () => listeners.delete(told); };
const tell = (away) => listeners.forEach((told) => told(away));

// Read `url`, again and again while the server is away: it may be starting again.
export const PAUSE_MS = 1000;
async function read(url) {
  for (;;) {
    try {
      const response = await fetch(url);
      tell(false);
      return response;
    } catch {
      tell(true);
      await new Promise((go) => setTimeout(go, PAUSE_MS));
    }
  }
}

// Change something there: once, for what was not answered may have been done.
async function send(method, path, body) {
  const options = { method, headers: {} };
  if (body !== undefined) {
    options.headers["content-type"] = "application/json";
    options.body = JSON.stringify(body);
  }
  try {
    return await answer(await fetch(`/api/v1${path}`, options));
  } catch (error) {
    throw error instanceof Problem ? error : new Problem("gone");
  }
}

export const get = async (path) => answer(await read(`/api/v1${path}`));
export const post = (path, body) => send("POST", path, body ?? {});
export const patch = (path, body) => send("PATCH", path, body);
export const remove = (path) => send("DELETE", path);

// Send a file; `told` hears the share that is there, and how to stop it.
export function upload(file, told = () => {}) {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.open("POST", `/api/v1/uploads?name=${encodeURIComponent(file.name)}`);
    request.setRequestHeader("content-type", "application/octet-stream");
    const stop = () => request.abort();
    request.upload.onprogress = (event) => event.total && told(event.loaded / event.total, stop);
    request.onabort = () => reject(new Problem("stopped"));
    request.onerror = () => reject(new Problem("gone"));
    request.onload = () => {
      let body = null;
      try { body = heed(JSON.parse(request.responseText)); } catch { /* said below */ }
      if (request.status < 300 && body) resolve(body);
      else reject(new Problem(body?.error ?? `${request.status}`));
    };
    request.send(file);
    told(0, stop);
  });
}

export const ended = (job) => ["done", "failed", "cancelled"].includes(job?.state);

// Follow a job until it ends; `told` hears each change. Returns a function that stops listening. All tabs share one stream,
// where the browser can.
let worker = null;
const heard = new Map();
export function follow(key, told) {
  if (typeof SharedWorker === "undefined") return alone(key, told);
  if (!worker) {
    worker = new SharedWorker("/stream.js").port;
    worker.onmessage = ({ data: { job, away } }) => { tell(Boolean(away)); if (heed(job)) for (const one of [...(heard.get(job.id) ?? [])]) one(job); };
    addEventListener("pagehide", () => { for (const one of heard.keys()) worker.postMessage({ leave: one }); });
    addEventListener("pageshow", ({ persisted }) => { if (persisted) for (const one of heard.keys()) worker.postMessage({ follow: one }); });
  }
  if (!heard.has(key)) heard.set(key, new Set());
  heard.get(key).add(told);
  worker.postMessage({ follow: key });
  return () => {
    if (!heard.get(key)?.delete(told) || heard.get(key).size) return;
    heard.delete(key);
    worker.postMessage({ leave: key });
  };
}

// The same with a stream of its own.
function alone(key, told) {
  let source = null, stopped = false;
  const hear = (job) => {
    if (stopped) return;
    if (ended(job)) source.close();
    told(job);
  };
  const open = () => {
    source = new EventSource(`/api/v1/jobs/${key}/events`);
    source.addEventListener("job", (event) => { tell(false); hear(heed(JSON.parse(event.data))); });
    source.onerror = async () => {
      if (source.readyState !== EventSource.CLOSED) return tell(true);  // the browser itself tries again
      const job = await get(`/jobs/${key}`).catch(() => null);
      if (!job || stopped) return;
      hear(job);
      if (!ended(job)) setTimeout(() => stopped || open(), PAUSE_MS);
    };
  };
  open();
  return () => { stopped = true; source.close(); };
}

export const fileOf = (job, name) => `/api/v1/jobs/${job.id}/files/${encodeURIComponent(name)}`;

// A picture of a job's part.
export async function tables(url, kinds) {
  const response = await read(url);
  if (!response.ok) await answer(response);
  return unpacked(await response.arrayBuffer(), kinds);
}
