// Measure: the test print, and what was seen of it, by scan, by callipers or as a table.
import { html, useEffect, useState } from "./vendor.js";
import { ended, fileOf, get, post, upload } from "./api.js";
import { ask } from "./ask.js";
import { Plate, Save } from "./drawings.js";
import { Drop } from "./drop.js";
import { Filament, Fit } from "./fit.js";
import { Photos, Problem, Progress, Sending, useEarlier, useJob, useSending } from "./job.js";
import { useLook, Zoom } from "./look.js";
import { Send } from "./send.js";
import { asked, mm, number, said, sentence, t, typed } from "./words.js";

export function Measure({ printer, changed, more, tell }) {
  const [probe, setProbe] = useState(null), [error, setError] = useState(null), [size, setSize] = useState(more ?? ""), [way, setWay] = useState("scan");
  const make = async (overwrite = false) => {
    try { setProbe(await post(`/printers/${printer.id}/probe`, { size_mm: asked(size), overwrite })); setError(null); changed(); } catch (problem) {
      if (!overwrite && /plan of another test print/.test(problem.message)) { if (await ask(t("overwrite_sure"), t("overwrite"))) await make(true); } else setError(problem.message);
    }
  };
  useEffect(() => { if (printer.has_probe) get(`/printers/${printer.id}/probe`).then((card) => setProbe((old) => old ?? card), () => {}); }, [printer.id]);
  const learned = () => { changed(); location.hash = `#/printers/${printer.id}/wrong`; };
  return html`<${Problem} error=${error} /><div class="split"><section class="card stack"><h2>${t("plate")}</h2><p class="soft">${t("plate_now")}</p>
      ${!printer.digest && printer.notes.map((note) => html`<p class="note">${t("not_taken", { what: said(note) })}</p>`)}
      ${probe && html`<div style=${{ height: "17rem" }}><${Plate} id="plate" marks=${probe.marks_mm} errors=${probe.marks_mm.map(() => [0, 0])} big=${probe.big} bed=${probe.bed_mm} enlarge="1" /></div><${Save} id="plate" name="plate" />
        <p><b>${t("plate_facts", { marks: probe.marks, minutes: number(probe.minutes, 0), grams: number(probe.grams, 1) })}</b><br /><span class="faint">${t("plate_left", { mm: mm(probe.expected_mm) })}</span></p>`}
      ${printer.has_probe && html`<a class="button primary" href=${`/api/v1/printers/${printer.id}/files/probe.gcode`} download>${t("download_plate")}</a><${Send} printer=${printer} changed=${changed} />`}
      <label class="field">${t("plate_size")}<input inputmode="decimal" value=${size} onInput=${(event) => setSize(event.target.value)} /></label>
      <button class=${printer.has_probe ? "" : "primary"} onClick=${() => make()}>${t(printer.has_probe ? "plate_again" : "plate_make")}</button></section>
    <div class="stack"><div class="segment" role="group" aria-label=${t("tab_measure")}>${["scan", "callipers", "table", "part"].map((one) => html`<button aria-pressed=${way === one} onClick=${() => setWay(one)}>${t(`by_${one}`)}</button>`)}</div>
      ${way === "scan" && html`<${Scan} printer=${printer} learned=${learned} tell=${tell} />`}
      ${way === "callipers" && html`<${Callipers} printer=${printer} learned=${learned} />`}
      ${way === "table" && html`<${Table} printer=${printer} learned=${learned} changed=${changed} />`}
      ${way === "part" && html`<${PartWay} printer=${printer} learned=${learned} />`}</div></div>`;
}

function PartWay({ printer, learned }) {
  const { learn, job, error } = useLearn(printer, learned);
  return html`<${Problem} error=${error} /><${Progress} job=${job} /><${Fit} printer=${printer} learn=${learn} learning=${job} />`;
}

// Learn as a job; `done` when it is over.
export function useLearn(printer, done) {
  const [key, setKey] = useState(null), [error, setError] = useState(null), job = useJob(key);
  useEffect(() => {
    if (job?.state === "done") done();
    if (job?.state === "failed") setError(job.error);
    if (ended(job)) setKey(null);
  }, [job?.state]);
  useEarlier(printer, (jobs) => { const going = jobs.find((one) => one.kind === "learn" && !ended(one)); if (going) setKey((old) => old ?? going.id); });
  const learn = async (given) => { setError(null); try { setKey((await post(`/printers/${printer.id}/learn`, given)).id); } catch (problem) { setError(problem.message); } };
  return { learn, job: key ? job ?? { id: key, state: "queued", share: 0 } : null, error };
}

function Scan({ printer, learned, tell }) {
  const [key, setKey] = useState(null), [error, setError] = useState(null), [now, send] = useSending(), [dpi, setDpi] = useState(""), [distance, setDistance] = useState("");
  const [out, setOut] = useState(new Set()), [uploads, setUploads] = useState([]), job = useJob(key), { learn, job: learning, error: failed } = useLearn(printer, learned);
  const run = async (keys) => {
    setOut(new Set());
    try { setKey((await post(`/printers/${printer.id}/measure`, { uploads: keys, dpi: asked(dpi), distance_mm: asked(distance) })).id); } catch (problem) { setError(problem.message); }
  };
  const take = async (files) => {
    setError(null); setKey(null);
    try { const keys = await send(files); setUploads(keys); await run(keys); } catch (problem) { setError(problem.message); }
  };
  useEffect(() => { if (job?.state === "done") setOut(new Set(job.result.odd)); if (job?.state === "failed") setError(job.error); }, [job?.state]);
  useEarlier(printer, (jobs) => {
    const last = jobs.find((one) => one.kind === "measure");
    if (!last || last.state === "cancelled" || last.state === "failed") return;
    setUploads((old) => old.length ? old : last.params.scans.map((one) => one.upload));
    setKey((old) => old ?? last.id);
  });
  const result = job?.state === "done" ? job.result : null, busy = Boolean(now) || Boolean(key && !ended(job));
  useEffect(() => { tell(result ? "measure_found" : null); return () => tell(null); }, [Boolean(result)]);
  const settle = (event) => { event.preventDefault(); setError(null); run(uploads); };
  const toggle = (mark) => setOut((old) => { const next = new Set(old); if (!next.delete(mark)) next.add(mark); return next; });
  return html`<${Problem} error=${error ?? (busy ? null : failed)} />
    <${Sending} now=${now} />
    ${key && !ended(job) && html`<section class="card"><${Progress} job=${job ?? { id: key, state: "queued", share: 0 }} steps=${["measure"]} /></section>`}
    <${Photos} job=${job} />
    ${result && html`<section class="card stack"><div class="row between"><h2>${t("marks_found", { found: result.marks - result.missing.length, marks: result.marks })}</h2>
        <button class="primary" disabled=${Boolean(learning)} onClick=${() => learn({ measurement: job.id, exclude: [...out] })}>${t(learning ? "learning" : "learn")}</button></div>
      <${Progress} job=${learning} /><${Marks} job=${job} out=${out} toggle=${toggle} /><p class="faint">${t("click_mark")}</p>
      ${result.asked && html`<form class="note stack" onSubmit=${settle}><p>${t("asked_now")}</p><div class="row" style=${{ alignItems: "end" }}><label class="field" style=${{ flex: "1 1 12rem" }}>${t("asked_field", { about: number(result.asked_mm, 0) })}<input inputmode="decimal" value=${distance} onInput=${(event) => setDistance(event.target.value)} /></label><button disabled=${!distance.trim() || Boolean(learning)}>${t("asked_take")}</button></div></form>`}
      <ul class="faint" style=${{ margin: 0, paddingLeft: "1.1rem" }}>${result.notes.map((note) => html`<li>${sentence(note)}</li>`)}</ul></section>`}
    <${Drop} multiple accept="image/*" onFiles=${take} disabled=${!printer.has_probe || busy}><p><b>${printer.has_probe ? t("drop_scan") : t("calliper_need")}</b></p><p class="faint">${t("scan_tip")}</p></${Drop}>
    <div class="grid" style=${{ alignItems: "end" }}><label class="field">${t("dpi")}<input inputmode="decimal" value=${dpi} onInput=${(event) => setDpi(event.target.value)} /></label>
      ${!result?.asked && html`<label class="field">${t("distance")}<input inputmode="decimal" value=${distance} onInput=${(event) => setDistance(event.target.value)} /></label>`}
      ${uploads.length > 0 && !busy && html`<button onClick=${() => run(uploads)}>${t("reread")}</button>`}</div>`;
}

// The scan with rings around what was found.
function Marks({ job, out, toggle }) {
  const { size_px: size, marks_px: marks, radius_px: radius, odd, asked: two } = job.result, ends = two?.map((mark) => marks[mark]).filter((place) => place[0] !== null) ?? [], odds = new Set(odd), { zoom, props } = useLook([0, 0, ...size]);
  const kind = (i) => (out.has(i) ? "out" : odds.has(i) ? "odd" : "found");
  const colour = { found: "var(--good)", odd: "var(--warn)", out: "var(--faint)" };
  return html`<div class="stage"><svg id="scan" class="fill" ...${props} role="img" aria-label=${t("scanned")}>
      ${job.files.includes("seen.jpg") && html`<image href=${fileOf(job, "seen.jpg")} width=${size[0]} height=${size[1]} />`}
      ${marks.map((place, i) => place[0] !== null && html`<circle cx=${place[0]} cy=${place[1]} r=${radius[i] * 1.5 + 2} fill="transparent" stroke=${colour[kind(i)]} stroke-width=${kind(i) === "found" ? 1.4 : 2.6} stroke-dasharray=${kind(i) === "out" ? "3 3" : undefined} vector-effect="non-scaling-stroke" style=${{ cursor: "pointer" }} onClick=${() => toggle(i)} />`)}
      ${job.result.missing_px?.map(([x, y]) => { const r = radius[0] * 2.5 + 4; return html`<path d=${`M${x - r} ${y - r}l${2 * r} ${2 * r}m0 ${-2 * r}l${-2 * r} ${2 * r}`} stroke="var(--printed)" stroke-width="2.6" vector-effect="non-scaling-stroke" />`; })}
      ${ends.length === 2 && html`<g class="asked" data-testid="asked"><line x1=${ends[0][0]} y1=${ends[0][1]} x2=${ends[1][0]} y2=${ends[1][1]} />${ends.map(([x, y]) => html`<ellipse cx=${x} cy=${y} rx=${Math.max(size[0] / 60, 12)} ry=${Math.max(size[0] / 60, 12)} />`)}</g>`}</svg>
    <div class="over"><div class="glass"><div class="row"><span class="ring odd">${t("odd")} ${odd.length}</span><span class="ring out">${t("left_out")} ${out.size}</span><span class="ring lost">${t("missing")} ${job.result.missing.length}</span></div></div>
      <div class="row"><${Zoom} zoom=${zoom} /><${Save} id="scan" name="scan" /></div></div></div>`;
}

function Callipers({ printer, learned }) {
  const [list, setList] = useState(null), [values, setValues] = useState([]), [error, setError] = useState(null);
  useEffect(() => { if (printer.has_probe) get(`/printers/${printer.id}/callipers`).then((found) => { setList(found); setValues(found.map(() => "")); }, (problem) => setError(problem.message)); }, [printer.has_probe]);
  const go = async () => {
    const readings = values.map((text) => (text.trim() === "" ? null : typed(text)));
    const wrong = readings.findIndex((value) => Number.isNaN(value));
    if (wrong >= 0) { setError(`${t("calliper_row", { n: wrong + 1, about: number(list[wrong].about_mm, 1) })}: ${values[wrong]}`); return; }
    setError(null);
    try { await post(`/printers/${printer.id}/callipers`, { readings_mm: readings }); learned(); } catch (problem) { setError(problem.message); }
  };
  if (!printer.has_probe) return html`<p class="note">${t("calliper_need")}</p>`;
  return html`<${Problem} error=${error} /><section class="card stack"><p class="soft">${t("calliper_now")}</p>
    <div class="grid">${list?.map((one, i) => html`<label class="field"><${Pair} bed=${printer.bed_mm} one=${one} n=${i + 1} />${t("calliper_row", { n: i + 1, about: number(one.about_mm, 1) })}
      <input inputmode="decimal" value=${values[i]} onInput=${(event) => setValues(values.map((old, j) => (i === j ? event.target.value : old)))} /></label>`)}</div>
    <button class="primary" disabled=${!list} onClick=${go}>${t("calliper_go")}</button></section>`;
}

function Pair({ bed: [x0, y0, x1, y1], one: { first_mm: a, second_mm: b }, n }) {
  const middle = [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2], across = [b[1] - a[1], a[0] - b[0]], inwards = across[0] * ((x0 + x1) / 2 - middle[0]) + across[1] * ((y0 + y1) / 2 - middle[1]) < 0 ? -1 : 1;
  const [x, y] = middle.map((v, i) => v + (15 * inwards * across[i]) / Math.hypot(...across)); // beside the line, on the bed's side
  return html`<svg viewBox="${x0 - 6} ${-y1 - 6} ${x1 - x0 + 12} ${y1 - y0 + 12}" style=${{ width: "100%", maxHeight: "9rem" }} aria-hidden="true"><rect x=${x0} y=${-y1} width=${x1 - x0} height=${y1 - y0} rx="4" fill="var(--well)" class="axis" />
    <path d=${`M${a[0]} ${-a[1]}L${b[0]} ${-b[1]}`} stroke="var(--accent)" stroke-width="1.6" vector-effect="non-scaling-stroke" />${[a, b].map((p) => html`<circle cx=${p[0]} cy=${-p[1]} r="5" fill="var(--accent)" />`)}
    <text x=${x} y=${-y + 6} text-anchor="middle" style=${{ fontSize: "18px", fontWeight: 600 }}>${n}</text></svg>`;
}

// A table as the program reads it: where the comma is the decimal sign, spreadsheets separate by semicolons or tabs, or
// put a number with one into quotes.
const pointed = (text) => `${/[;\t]/.test(text) ? text.replaceAll(",", ".").replaceAll(/[;\t]/g, ",") : text.replaceAll(/"(-?\d+),(\d+)"/g, "$1.$2")}`.trimEnd() + "\n";

// For what no flat print shows: a tower, and the table that says where its corners were told to be.
function Tower({ printer, changed }) {
  const [made, setMade] = useState(null), [error, setError] = useState(null), file = (name) => `/api/v1/printers/${printer.id}/files/${name}`;
  useEffect(() => { get(`/printers/${printer.id}/tower`).then((card) => setMade((old) => old ?? card), () => {}); }, [printer.id]);
  const make = async () => { try { setMade(await post(`/printers/${printer.id}/tower`)); setError(null); } catch (problem) { setError(problem.message); } };
  return html`<section class="card stack"><h2>${t("tower")}</h2><p class="soft">${t(printer.digest ? "tower_now" : "tower_later")}</p><${Problem} error=${error} />
    ${made ? html`<p><b>${t("tower_facts", { height: number(made.height_mm, 1), minutes: number(made.minutes, 0), grams: number(made.grams, 1) })}</b></p>
      <div class="row"><a class="button primary" href=${file("tower.gcode")} download>${t("download_tower")}</a><a class="button" href=${file("tower.csv")} download>${t("tower_table")}</a></div><${Send} printer=${printer} changed=${changed} file=${{ name: "tower.gcode" }} />
      <p class="faint">${t("tower_fill")}</p>`
      : html`<button disabled=${!printer.digest} onClick=${make}>${t("tower_make")}</button>`}</section>`;
}

function Table({ printer, learned, changed }) {
  const [text, setText] = useState(""), [filament, setFilament] = useState(""), { learn, job, error } = useLearn(printer, learned), [failed, setFailed] = useState(null);
  const go = async (file) => { try { await learn({ upload: (await upload(new File([pointed(await file.text())], "trace.csv"))).id, filament: filament.trim() || null }); setFailed(null); } catch (problem) { setFailed(problem.message); } };
  return html`<${Problem} error=${failed ?? error} /><section class="card stack"><label class="field"><span>${t("table_now")}</span>
      <textarea rows="12" spellcheck="false" value=${text} placeholder="x_mm,y_mm,x_measured_mm,y_measured_mm" onInput=${(event) => setText(event.target.value)}></textarea></label>
    <${Filament} printer=${printer} value=${filament} set=${setFilament} />
    <${Progress} job=${job} /><button class="primary" disabled=${!text.trim() || Boolean(job)} onClick=${() => go(new File([text], "trace.csv"))}>${t(job ? "learning" : "table_go")}</button></section>
    <${Tower} printer=${printer} changed=${changed} />
    <${Drop} accept=".csv,text/csv" onFiles=${([file]) => go(file)}><p>${t("drop_table")}</p></${Drop}>`;
}
