// Mend: files in, and each as wanted, as this printer prints it, and mended.
import { html, useEffect, useState } from "./vendor.js";
import { ended, fileOf, get, post, remove } from "./api.js";
import { Number_, Save, ticks, wide } from "./drawings.js";
import { Drop } from "./drop.js";
import { Problem, Progress, Sending, useJob, useSending } from "./job.js";
import { Part } from "./part.js";
import { useScene } from "./scene.js";
import { Send } from "./send.js";
import { lasting, mm, number, sentence, t, time } from "./words.js";

const STEPS = ["read", "rewrite", "draw"];

// A job that is done may have refused to mend.
const stateOf = (job) => job.result?.refused ? "failed" : job.state;

// What a row of the list shows of a job.
function rowOf(job) {
  const p = job.result?.prediction;
  return { at_s: job.created_s, state: stateOf(job), drawn: job.files.includes("thumb.svg"), filament: job.params.filament, numbers: p && (job.result.refused || job.result.untouched ? `${mm(p.before.rms_mm)} mm` : `${mm(p.before.rms_mm)} → ${mm(p.after.rms_mm)} mm`) };
}

export function Mend({ printer, changed }) {
  const [now, send] = useSending(), [rows, setRows] = useState([]), [shown, setShown] = useState(null), [error, setError] = useState(null), [filament, setFilament] = useState("");
  useEffect(() => {
    get(`/jobs?printer=${printer.id}`).then((jobs) => {
      const mine = jobs.filter((job) => job.kind === "mend").slice(0, 30).map((job) => ({ id: job.id, name: job.params.name, ...rowOf(job) }));
      setRows((old) => [...old, ...mine.filter((job) => !old.some((row) => row.id === job.id))]); // a file may have been dropped meanwhile
      if (mine.length) setShown((old) => old ?? mine[0].id);
    }, (problem) => setError(problem.message));
  }, [printer.id]);
  const running = rows.some((row) => row.id && !ended(row));
  useEffect(() => { // how those go on that are not shown
    if (!running) return undefined;
    let timer, stopped = false;
    const later = () => { timer = setTimeout(look, 1500); };
    const look = () => get(`/jobs?printer=${printer.id}`).then((jobs) => {
      const now = new Map(jobs.map((job) => [job.id, rowOf(job)]));
      if (!stopped) setRows((old) => old.map((row) => ({ ...row, ...now.get(row.id) })));
    }, () => {}).then(() => stopped || later());
    later();
    return () => { stopped = true; clearTimeout(timer); };
  }, [running]);
  const take = async (files) => {
    setError(null);
    let fresh = true; // of several the first is shown
    for (const file of files) {
      const row = { id: null, name: file.name, state: "sending", filament, at: Math.random() };
      const put = (values) => setRows((old) => old.filter((one) => one.at === row.at || !one.id || one.id !== values.id).map((one) => (one.at === row.at ? { ...one, ...values } : one)));
      setRows((old) => [row, ...old]);
      try {
        const job = await post(`/printers/${printer.id}/mend`, { upload: (await send([file]))[0], filament: filament || null });
        put({ id: job.id, state: job.state });
        if (fresh) setShown(job.id);
        fresh = false;
      } catch (problem) { put({ state: problem.message === "stopped" ? "cancelled" : "failed" }); setError(problem.message); }
    }
  };
  const forget = async (row) => {
    setError(null);
    if (row.id === shown) { const at = rows.indexOf(row); setShown((rows[at + 1] ?? rows[at - 1])?.id ?? null); } // nobody follows it any more
    try {
      if (row.id) await remove(`/jobs/${row.id}`);
      setRows((old) => old.filter((one) => (row.id ? one.id !== row.id : one.at !== row.at)));
    } catch (problem) { setError(problem.message); }
  };
  const anyway = async (job) => { // the file is the same: its new job takes the old one's place
    setError(null);
    try {
      const next = await post(`/printers/${printer.id}/mend`, { upload: job.params.upload, force: true, filament: job.params.filament ?? null });
      setRows((old) => old.map((one) => (one.id === job.id ? { ...one, id: next.id, state: next.state } : one)));
      setShown(next.id);
      await remove(`/jobs/${job.id}`);
    } catch (problem) { setError(problem.message); }
  };
  return html`<${Problem} error=${error} /><div class="split"><div class="stack">
      <${Drop} multiple accept=".gcode,.g,.gco,.bgcode,.3mf,.nc,.ngc" onFiles=${take}><p><b>${t("drop_gcode")}</b></p></${Drop}><${Sending} now=${now} />
      ${printer.filaments.length > 0 && html`<label class="field">${t("mend_filament")}<select value=${filament} onChange=${(event) => setFilament(event.target.value)}><option value="">${t("mend_slicer")}</option>${printer.filaments.map((name) => html`<option value=${name}>${name}</option>`)}</select></label>`}
      ${rows.length > 0 && html`<section class="card stack"><h2>${t("files")}</h2>${rows.map((row) => html`<div class="file" key=${row.id ?? row.at}><button class="quiet" aria-pressed=${row.id === shown} disabled=${!row.id} onClick=${() => { setShown(row.id); setError(null); }}>${row.drawn ? html`<img class="thumb" src=${fileOf(row, "thumb.svg")} alt="" />` : html`<i class="thumb"></i>`}<span class="fname">${row.name}${[row.at_s && time(row.at_s), row.filament, row.numbers].filter(Boolean).map((line) => html`<br /><span class="faint">${line}</span>`)}</span>
        <span class="tag">${row.state === "sending" ? t("sending") : row.state === "failed" ? t("refused") : row.state === "cancelled" ? t("stopped") : ended(row) ? t("ready") : t(row.state === "queued" ? "waits" : "mending")}</span></button>
        <button class="quiet icon" disabled=${row.state === "sending"} title=${t("forget", { name: row.name })} aria-label=${t("forget", { name: row.name })} onClick=${() => forget(row)}>×</button></div>`)}</section>`}</div>
    <div class="stack"><${File_} id=${shown} printer=${printer} changed=${changed} anyway=${anyway} /></div></div>`;
}

// What will be there: a part, left as it prints, right mended.
const half = (from, r, off) => Array.from({ length: 61 }, (_, i) => {
  const angle = from + (i / 60) * Math.PI, to = r + off * Math.sin(6 * angle);
  return `${i ? "L" : "M"}${(to * Math.cos(angle)).toFixed(1)} ${(-to * Math.sin(angle)).toFixed(1)}`;
}).join("");
export const GhostPart = () => html`<svg class="ghost" viewBox="-60 -60 120 120" width="200" aria-hidden="true"><path d="M0 -58V58" class="axis" />
  ${[50, 20].map((r) => html`<path d=${half(Math.PI / 2, r, 0.08 * r)} class="p" stroke-width="3" /><path d=${half(-Math.PI / 2, r, 0)} class="m" stroke-width="3" />`)}</svg>`;

function File_({ id, printer, changed, anyway }) {
  const job = useJob(id), [scene, error] = useScene(job), [asked, setAsked] = useState(null);
  const result = job?.state === "done" ? job.result : null;
  return html`<${Problem} error=${job?.state === "failed" ? job.error : result?.refused ?? error} />
    ${job?.may_force && html`<div class="row"><button disabled=${asked === job.id} onClick=${() => { setAsked(job.id); anyway(job).then(() => setAsked(null)); }}>${t("anyway")}</button><span class="faint">${t("anyway_now")}</span></div>`}
    ${job?.state === "cancelled" && html`<p class="note">${t("stopped")}</p>`}
    <${Part} scene=${scene} bed=${printer.bed_mm} name=${job?.params.name ?? "part"} morph=${scene?.mended ? 2 : 1} busy=${Boolean(job) && !ended(job)} moment=${Boolean(result && !result.refused && !result.untouched)} share=${result && !result.refused && { numbers: { before_mm: result.prediction.before.rms_mm, after_mm: result.prediction.after.rms_mm }, printer: printer.name, part: job.params.name }}>
      ${!id ? html`<div class="soon"><${GhostPart} /><p>${t("soon")}</p></div>` : ended(job) && !scene && !job.files.includes("printed.bin") && html`<p class="soon">${t("no_picture")}</p>`}${job && !ended(job) && html`<section class="card busy ${scene ? "low" : ""}"><${Progress} job=${job} steps=${scene ? null : STEPS} /></section>`}</${Part}>
    ${result && html`<${Numbers} job=${job} printer=${printer} changed=${changed} />`}`;
}

function Numbers({ job, printer, changed }) {
  const { prediction: p, output, layers, pace, untouched } = job.result, more = pace && output;
  return html`<section class="card stack"><div class="row between" style=${{ alignItems: "start" }}><div class="numbers" style=${{ flex: 1 }}>
        <${Number_} value=${mm(p.before.rms_mm)}>${t("rms_raw")}<br />${t("p95", { mm: mm(p.before.p95_mm) })}${untouched && html`<br />${t("range", { low: mm(p.before.rms_low_mm), high: mm(p.before.rms_high_mm) })}`}</${Number_}>
        ${untouched ? null : html`<${Number_} value=${mm(p.after.rms_mm)}>${t("rms_mended")}<br />${t("p95", { mm: mm(p.after.p95_mm) })}${p.after.rms_high_mm > p.after.rms_low_mm && html`<br />${t("range", { low: mm(p.after.rms_low_mm), high: mm(p.after.rms_high_mm) })}`}</${Number_}>`}</div>
      ${output && html`<div class="stack beside"><a class="button primary big" href=${fileOf(job, output)} download=${output}>${t(untouched ? "download_same" : "download")}</a><${Send} printer=${printer} changed=${changed} file=${{ job: job.id, name: output }} /></div>`}</div>
    <p class="faint">${pace && html`${t(pace.told ? "time" : "time_least", { time: lasting(pace.before_s) })}${more && html` → <b>${lasting(pace.after_s)}</b>`}<br />`}
      ${untouched ? t("untouched") : t("moves", { before: number(p.moves, 0), after: number(p.commands, 0), n: number(p.takeups, 0) })}${more && html`<br />${t("busiest", { before: number(pace.busiest[0], 0), after: number(pace.busiest[1], 0) })}`}${more && p.stops > 0 && html`<br />${t("stops", { n: number(p.stops, 0) })}`}<br />${p.clamped > 0 ? html`${t("clamped", { n: number(p.clamped, 0) })}` : p.on_bed === false ? t("off_bed") : p.unknown || p.splines ? "" : t("on_bed")}</p>
    ${shift(p) && html`<p>${shift(p)}</p>`}
    ${left(p).map((line) => html`<p class="note">${line}</p>`)}
    ${[...p.advice, ...p.warnings ?? []].map((line) => html`<p class="note">${sentence(line)}</p>`)}
    ${layers.length > 1 && html`<div><div class="row between"><h3>${t("by_layer")}</h3><div class="row"><span class="key kp">${t("printed")}</span>${untouched ? null : html`<span class="key km">${t("mended")}</span>`}<${Save} id="layers" name="layers" /></div></div><${Layers} layers=${layers} untouched=${untouched} /></div>`}</section>`;
}

// Where all of the print lies beside its place: no error of its shape.
function shift({ shift_mm: by, of_shape: out, before, after }) {
  const [x, y] = by ?? [0, 0], far = Math.hypot(x, y), signed = (v) => (v < 0 ? "−" : "+") + number(Math.abs(v), 2);
  return far >= 0.005 && before.rms_mm !== after.rms_mm ? t(out ? "shift_out" : "shift_in", { mm: mm(far), x: signed(x), y: signed(y) }) : "";
}

// What mending had to leave as the file has it, or cannot promise.
function left({ unknown, unknown_lines: lines, splines, coarse, geometry }) {
  const where = lines?.length ? t("left_lines", { lines: lines.join(", ") + (unknown > lines.length ? " …" : "") }) : "";
  return [[unknown, "left_unknown"], [splines, "left_splines"], [coarse, "left_coarse"], [geometry, "left_geometry"]].filter(([count]) => count > 0).map(([count, key]) => t(key, { n: number(count, 0), where }));
}

function Layers({ layers, untouched }) {
  const W = wide(), H = 170, left = 46, right = 24, most = Math.max(...layers.map(([, a, b]) => Math.max(a, b)), 0.01), top = layers.at(-1)[0] || 1;
  const x = (z) => left + (z / top) * (W - left - right), y = (v) => 8 + (1 - v / most) * (H - 34);
  const line = (k) => layers.map((row, i) => `${i ? "L" : "M"}${x(row[0]).toFixed(1)} ${y(row[k]).toFixed(1)}`).join("");
  return html`<svg id="layers" viewBox="0 0 ${W} ${H}" style=${{ width: "100%" }} role="img" aria-label=${t("by_layer")}>${ticks(0, most, 5).map(([v, text]) => html`<g><path d=${`M${left} ${y(v)}H${W - right}`} class="axis" /><text x=${left - 6} y=${y(v) + 4} text-anchor="end">${text}</text></g>`)}
    ${ticks(0, top, 4).map(([v, text]) => html`<text x=${x(v)} y=${H - 6} text-anchor="middle">${text} mm</text>`)}<path d=${line(1)} class="p" stroke-width="2" />${untouched ? null : html`<path d=${line(2)} class="m" stroke-width="2" />`}</svg>`;
}
