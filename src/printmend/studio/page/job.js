// A job as one sees it: what it is doing, how long it may take, and a way to stop it.
import { html, useEffect, useState } from "./vendor.js";
import { ended, fileOf, follow, get, post, upload } from "./api.js";
import { seconds, t, why } from "./words.js";

// Follow the job `key`; null without one.
export function useJob(key) {
  const [job, setJob] = useState(null);
  useEffect(() => {
    setJob(null);
    return key ? follow(key, setJob) : undefined;
  }, [key]);
  return job?.id === key ? job : null; // not that of the key before
}

// What a screen goes on with that was left or loaded anew: `found` hears the printer's jobs, the newest first.
export function useEarlier(printer, found) {
  useEffect(() => {
    let here = true;
    get(`/jobs?printer=${printer.id}`).then((jobs) => here && found(jobs), () => {});
    return () => { here = false; };
  }, [printer.id]);
}

export function Progress({ job, steps }) {
  if (!job || ended(job)) return null;
  const waits = job.state === "queued" && job.ahead > 0, at = steps && !waits ? Math.max(steps.indexOf(job.step), 0) : -1;
  return html`<div class="stack" role="status" aria-live="polite">
    <progress max="1" value=${job.share} aria-label=${t(job.step ? `step_${job.step}` : "starting")}></progress>
    <div class="row between"><span class="faint">${waits ? t("ahead", { n: job.ahead }) : job.step ? `${steps ? "" : `${t(`step_${job.step}`)} `}${seconds(job.left_s)}` : t("starting")}</span>
      <button class="quiet" onClick=${() => post(`/jobs/${job.id}/cancel`).catch(() => {})}>${t("cancel")}</button></div>
    ${steps && html`<ol class="steps">${steps.map((step, i) => html`<li class=${i < at ? "done" : i === at ? "is" : ""}>${t(`step_${step}`)}</li>`)}</ol>`}
  </div>`;
}

// Send files, one after another, for their keys; `now` says how far that is, null when nothing is sent.
export function useSending() {
  const [now, setNow] = useState(null);
  const send = async (files) => {
    const keys = [], begun = Date.now();
    const told = (share, stop) => { const spent = (Date.now() - begun) / 1000; setNow({ share, stop, left_s: share > 0.02 && spent > 0.5 ? (spent * (1 - share)) / share : null }); };
    try { for (const [i, file] of files.entries()) keys.push((await upload(file, (share, stop) => told((i + share) / files.length, stop))).id); } finally { setNow(null); }
    return keys;
  };
  return [now, send];
}

export const Sending = ({ now }) => now && html`<section class="card stack" role="status"><progress max="1" value=${now.share} aria-label=${t("sending")}></progress>
    <div class="row between"><span class="faint">${t("sending")} ${seconds(now.left_s)}</span><button class="quiet" onClick=${now.stop}>${t("cancel")}</button></div></section>`;

// The scans or photos that a job was given, as small pictures.
export const Photos = ({ job }) => job?.params.scans?.length > 0 && html`<div class="row thumbs">${job.params.scans.map(({ name }, i) => job.files.includes(`photo-${i + 1}.jpg`) && html`<img class="photo" src=${fileOf(job, `photo-${i + 1}.jpg`)} alt=${name} title=${name} />`)}</div>`;

// The message of the last failure, of which the next thing that is done takes the place: `tried(work)` does it.
export function useProblem() {
  const [error, setError] = useState(null);
  const tried = async (work) => { setError(null); try { await work(); } catch (problem) { setError(problem.message); } };
  return [error, tried, setError];
}

export const Problem = ({ error }) => error && html`<p class="problem" role="alert">${["gone", "stopped"].includes(error) ? t(error) : why(error)}</p>`;
