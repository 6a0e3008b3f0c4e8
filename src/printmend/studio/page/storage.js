// Storage: what the studio keeps on the disk, and how to be free of it.
import { html, useEffect, useState } from "./vendor.js";
import { get, remove } from "./api.js";
import { ask } from "./ask.js";
import { Problem, useProblem } from "./job.js";
import { useTitle } from "./title.js";
import { bytes, t } from "./words.js";

export function Storage() {
  const [kept, setKept] = useState(null), [error, tried, setError] = useProblem(), [busy, setBusy] = useState(null);
  useTitle(t("storage"));
  useEffect(() => { get("/storage").then(setKept, (problem) => setError(problem.message)); }, []);
  const free = async ({ part, bytes: size }) => {
    if (!(await ask(t("free_sure", { what: t(`stored_${part}`), size: bytes(size) }), t("free_this")))) return;
    setBusy(part);
    await tried(async () => setKept(await remove(`/storage/${part}`)));
    setBusy(null);
  };
  const whole = kept ? kept.kept_bytes + kept.parts.reduce((sum, one) => sum + one.bytes, 0) : 0;
  return html`<div class="head"><div><h1>${t("storage")}</h1><p class="now">${kept ? t("storage_now", { size: bytes(whole), most: bytes(kept.most_bytes), free: bytes(kept.free_bytes) }) : t("drawing")}</p></div></div><${Problem} error=${error} />
    ${kept && html`<section class="card stack">${kept.parts.map((one) => html`<div class="stored"><div><h2>${t(`stored_${one.part}`)}</h2><p class="faint">${t(`stored_${one.part}_why`)}</p>${one.shown.length > 0 && html`<div class="row thumbs">${one.shown.map((address) => html`<img class="thumb" src=${address} alt="" loading="lazy" />`)}</div>`}</div><b>${bytes(one.bytes)}</b><button disabled=${!one.count || busy === one.part} onClick=${() => free(one)}>${t("free_this")}</button></div>`)}
      <div class="stored"><div><h2>${t("stored_kept")}</h2><p class="faint">${t("stored_kept_why")}</p></div><b>${bytes(kept.kept_bytes)}</b><span class="tag">${t("stays")}</span></div></section>`}`;
}
