// Prove: the mended test print, measured; promise against result, and how both went over time.
import { html, useEffect, useState } from "./vendor.js";
import { ended, fileOf, get, post } from "./api.js";
import { Number_, Save, wide } from "./drawings.js";
import { Drop } from "./drop.js";
import { Filament, isCode } from "./fit.js";
import { Photos, Problem, Progress, Sending, useEarlier, useJob, useProblem, useSending } from "./job.js";
import { Send } from "./send.js";
import { asked, day, mm, number, sentence, t } from "./words.js";

const VERDICTS = { kept: "kept", broken: "broken_promise", "cannot tell": "cannot_tell" };

export function Prove({ printer, changed }) {
  const [now, send] = useSending(), [check, setCheck] = useState(null), [key, setKey] = useState(null), [error, tried, setError] = useProblem(), [known, setKnown] = useState(null), [distance, setDistance] = useState(""), [taken, setTaken] = useState(false), [looked, setLooked] = useState(false);
  const checked = useJob(check), job = useJob(key);
  const load = () => get(`/printers/${printer.id}/known`).then(setKnown, (problem) => setError(problem.message));
  useEffect(() => { load(); }, [printer.id, job?.state]);
  useEffect(() => { for (const one of [checked, job]) if (one?.state === "failed") setError(one.error); }, [checked?.state, job?.state]);
  useEarlier(printer, (jobs) => { // a check print of this model, and what was measured since it was learned
    const made = jobs.find((one) => one.kind === "check" && (!ended(one) || one.result?.digest === printer.digest)), seen = jobs.find((one) => one.kind === "verify");
    if (made) setCheck((old) => old ?? made.id);
    setLooked(true);
    if (seen && (!ended(seen) || (seen.state === "done" && seen.ended_s > printer.measured_s))) setKey((old) => old ?? seen.id);
  });
  const make = () => tried(async () => setCheck((await post(`/printers/${printer.id}/check`)).id));
  const [part, setPart] = useState(null), [filament, setFilament] = useState("");
  const take = (files) => tried(async () => { // scans, and the file of a part of one's own with them or before
    setTaken(false);
    const code = files.filter(isCode).slice(0, 1), scans = files.filter((file) => !isCode(file)), keys = await send([...code, ...scans]), of = code.length ? keys[0] : part;
    setPart(of);
    if (!scans.length) return;
    setKey((await post(`/printers/${printer.id}/verify`, { uploads: keys.slice(code.length), distance_mm: asked(distance), part: of, filament: filament.trim() || null })).id);
    setPart(null);
  });
  const over = () => tried(async () => { await post(`/printers/${printer.id}/update/${key}`); setTaken(true); changed(); load(); });
  const verdict = job?.state === "done" ? job.result.verdict : null;
  return html`<${Problem} error=${error} /><div class="split"><div class="stack">
      <section class="card stack"><h2>${t("prove_print")}</h2>${checked?.state === "done" ? html`<a class="button primary" href=${fileOf(checked, "check.mended.gcode")} download>${t("download_check")}</a><${Send} printer=${printer} changed=${changed} file=${{ job: checked.id, name: "check.mended.gcode" }} />` : looked && html`<p class="soft">${t("check_what")}</p><button class="primary" disabled=${check && !ended(checked)} onClick=${make}>${t("make_check")}</button>`}<${Progress} job=${checked} /></section>
      <section class="card stack"><h2>${t("prove_scan")}</h2><${Drop} multiple accept="image/*,.csv,.gcode,.g,.gco,.bgcode,.3mf" onFiles=${take}><p><b>${t("drop_check")}</b></p><p class="faint">${t(part ? "part_scans" : "check_part")}</p></${Drop}><${Sending} now=${now} />
        <label class="field">${t("distance")}<input inputmode="decimal" value=${distance} onInput=${(event) => setDistance(event.target.value)} /></label><${Filament} printer=${printer} value=${filament} set=${setFilament} /><${Photos} job=${job} /><${Progress} job=${job} steps=${["measure", "compare"]} /></section></div>
    <div class="stack">${verdict && html`<section class="card stack"><h2>${t(VERDICTS[verdict.result])}</h2><div class="numbers"><${Number_} value=${mm(verdict.before_mm)}>${t("was")}</${Number_}><${Number_} value=${verdict.now_at_most_mm == null ? mm(verdict.now_mm) : `< ${mm(verdict.now_at_most_mm)}`}>${t("measured_now")}</${Number_}><${Number_} value=${`${mm(verdict.promised_low_mm)} – ${mm(verdict.promised_high_mm)}`}>${t("promised")}</${Number_}></div>${verdict.result === "cannot tell" && html`<p class="note">${t("cannot_tell_why")} ${mm(verdict.shows_from_mm)}.</p>`}
        ${job.result.newer.split("\n").map((line) => html`<p class="faint">${sentence(line)}</p>`)}${job.result.asked?.map((line) => html`<p class="faint">${sentence(line)}</p>`)}${taken ? html`<p class="note">${t("taken")}</p>` : html`<div><button onClick=${over}>${t("take_over")}</button></div>`}</section>`}
      <section class="card stack"><div class="row between"><h2>${t("history")}</h2>${known?.history.length > 0 && html`<${Save} id="history" name="history" />`}</div>${known?.history.length ? html`<p class="faint">${t("history_axis")}</p><${History} events=${known.history} /><div class="row"><span class="key kp">${t("was")}</span><span class="key kb">${t("promised")}</span><span class="key km">${t("history_after")}</span></div>` : html`<p class="soft">${known ? t("history_none") : "…"}</p>${known && html`<${GhostHistory} />`}`}</section></div></div>`;
}

// What the history will look like.
export function GhostHistory() {
  const rows = [[60, 40], [150, 30], [240, 118], [330, 112]];
  return html`<svg class="ghost" viewBox="0 0 400 140" style=${{ width: "100%" }} aria-hidden="true"><path d="M30 130H390M30 70H390M30 10H390" class="axis" />${rows.map(([x, y]) => html`<g><rect x=${x - 9} y="104" width="18" height="20" rx="5" fill="var(--accent-soft)" stroke="var(--accent)" /><circle cx=${x} cy=${y} r="6" class=${y > 100 ? "fm" : "fp"} /></g>`)}</svg>`;
}

function History({ events }) {
  const W = wide(), H = 268, left = 52, bottom = 40, step = (W - left - 40) / Math.max(events.length, 1);
  const most = Math.max(...events.map((one) => Math.max(one.now_mm ?? 0, one.promised_high_mm ?? 0, one.before_mm ?? 0)), 0.02);
  const x = (i) => left + step * (i + 0.5), y = (v) => 14 + (1 - Math.sqrt(v / most)) * (H - bottom - 22);
  return html`<svg id="history" viewBox="0 0 ${W} ${H}" style=${{ width: "100%" }} role="img" aria-label=${t("history")}>
    ${[0, most / 16, most / 4, most].map((v) => html`<g><path d=${`M${left} ${y(v)}H${W - 8}`} class="axis" /><text x=${left - 6} y=${y(v) + 4} text-anchor="end">${v === 0 ? 0 : number(v, v < 0.1 ? 3 : 2)}</text></g>`)}
    ${events.map((one, i) => html`<g>${one.promised_high_mm !== undefined && html`<rect x=${x(i) - 12} width="24" rx="5" y=${y(one.promised_high_mm)} height=${Math.max(3, y(one.promised_low_mm) - y(one.promised_high_mm))} fill="var(--accent-soft)" stroke="var(--accent)" /><circle cx=${x(i)} cy=${y(one.before_mm)} r="5" class="fp" />`}
      ${one.now_at_most_mm != null ? html`<path d=${`M${x(i)} ${y(0)}V${y(one.now_at_most_mm)}M${x(i) - 8} ${y(one.now_at_most_mm)}h16`} class="m" stroke-width="4" />` : html`<circle cx=${x(i)} cy=${y(one.now_mm ?? 0)} r="6" class=${one.event === "learned" ? "fp" : "fm"} />`}<text x=${x(i)} y=${H - 20} text-anchor="middle">${t(`event_${one.event}`)}</text><text x=${x(i)} y=${H - 5} text-anchor="middle">${day(one.at_s)}</text></g>`)}</svg>`;
}
