// A job as one sees it: what it is doing, how long it may take, and a way to stop it.
import { html, useEffect, useState } from "./vendor.js";
import { ended, follow, post } from "./api.js";
import { seconds, t, why } from "./words.js";

// Follow the job `key`; null without one.
export function useJob(key) {
  const [job, setJob] = useState(null);
  useEffect(() => {
    setJob(null);
    return key ? follow(key, setJob) : undefined;
  }, [key]);
  return key ? job : null;
}

export function Progress({ job, steps }) {
  if (!job || ended(job)) return null;
  const at = steps ? steps.indexOf(job.step) : -1;
  return html`<div class="stack" role="status" aria-live="polite">
    <progress max="1" value=${job.share} aria-label=${t("mending")}></progress>
    <div class="row between"><span class="faint">${job.state === "queued" && job.ahead ? t("ahead", { n: job.ahead }) : seconds(job.left_s)}</span>
      <button class="quiet" onClick=${() => post(`/jobs/${job.id}/cancel`).catch(() => {})}>${t("cancel")}</button></div>
    ${steps && html`<ol class="steps">${steps.map((step, i) => html`<li class=${i < at ? "done" : i === at ? "is" : ""}>${t(`step_${step}`)}</li>`)}</ol>`}
  </div>`;
}

export const Problem = ({ error }) => error && html`<p class="problem" role="alert">${error === "gone" ? t("gone") : why(error)}</p>`;
