// Does it fit? A part's scans and its file in; sizes, and what its slicer must be told, out.
import { html, useEffect, useState } from "./vendor.js";
import { ended, fileOf, post } from "./api.js";
import { Drop } from "./drop.js";
import { Photos, Problem, Progress, Sending, useEarlier, useJob, useSending } from "./job.js";
import { asked, number, t } from "./words.js";

export const isCode = (file) => /\.(gcode|g|gco|bgcode|3mf)$/i.test(file.name);

// Which filament: those that the printer knows, and any other whose name begins with its polymer.
export function Filament({ printer, value, set }) {
  return html`<label class="field">${t("filament")}<input list="filaments" value=${value} placeholder="pla-black" onInput=${(event) => set(event.target.value)} />
    <datalist id="filaments">${[...new Set([...printer.filaments, "pla", "petg", "abs", "asa", "pa", "pc", "tpu", "pp", "hips"])].map((name) => html`<option value=${name} />`)}</datalist></label>`;
}

export function Fit({ printer, learn, learning }) {
  const [key, setKey] = useState(null), [error, setError] = useState(null), [now, send] = useSending(), [given, setGiven] = useState({ upload: null, uploads: [] });
  const [filament, setFilament] = useState(printer.filaments[0] ?? ""), [dpi, setDpi] = useState(""), [widths, setWidths] = useState(["", ""]), job = useJob(key);
  const run = async (next) => {
    setError(null);
    try { setKey((await post(`/printers/${printer.id}/fit`, { ...next, filament: filament.trim() || null, dpi: asked(dpi), distances_mm: widths.map(asked).filter((one) => one !== null) })).id); } catch (problem) { setError(problem.message); }
  };
  const take = async (files) => {
    setError(null); setKey(null);
    try {
      const code = files.filter(isCode).slice(0, 1), pictures = files.filter((file) => !isCode(file)).slice(0, 2);
      const keys = await send([...code, ...pictures]), next = { upload: code.length ? keys[0] : given.upload, uploads: pictures.length ? keys.slice(code.length) : given.uploads };
      setGiven(next);
      if (next.upload && next.uploads.length) await run(next);
    } catch (problem) { setError(problem.message); }
  };
  useEffect(() => { if (job?.state === "failed") setError(job.error); }, [job?.state]);
  useEarlier(printer, (jobs) => {
    const last = jobs.find((one) => one.kind === "fit");
    if (!last || last.state === "cancelled" || last.state === "failed") return;
    setGiven((old) => old.upload ? old : { upload: last.params.upload, uploads: last.params.scans.map((one) => one.upload) });
    setKey((old) => old ?? last.id);
  });
  const result = job?.state === "done" ? job.result : null, going = Boolean(now) || Boolean(key && !ended(job)), ready = given.upload && given.uploads.length > 0;
  return html`<${Problem} error=${error} /><${Sending} now=${now} />
    ${key && !ended(job) && html`<section class="card"><${Progress} job=${job ?? { id: key, state: "queued", share: 0 }} steps=${["measure", "compare"]} /></section>`}
    <${Photos} job=${job} />
    ${result && html`<${Sizes} job=${job} learn=${learn} learning=${learning} />`}
    <${Drop} multiple accept="image/*,.gcode,.g,.gco,.bgcode,.3mf" onFiles=${take} disabled=${going}><p><b>${t("drop_part")}</b></p><p class="faint">${t(ready ? "part_ready" : given.upload ? "part_scans" : given.uploads.length ? "part_file" : "part_tip")}</p></${Drop}>
    <div class="grid" style=${{ alignItems: "end" }}><${Filament} printer=${printer} value=${filament} set=${setFilament} />
      <label class="field">${t("dpi")}<input inputmode="decimal" value=${dpi} onInput=${(event) => setDpi(event.target.value)} /></label>
      ${result?.asked.map(({ degrees, about_mm: about }, i) => html`<label class="field">${t("width_field", { way: degrees === 0 ? "X" : degrees === 90 ? "Y" : `${degrees}°`, about: number(about, 1) })}<input inputmode="decimal" value=${widths[i]} onInput=${(event) => setWidths(widths.map((old, j) => (i === j ? event.target.value : old)))} /></label>`)}
      ${ready && !going && html`<button onClick=${() => run(given)}>${t("reread")}</button>`}</div>`;
}

// How large the part came out, and what to type.
function Sizes({ job, learn, learning }) {
  const { numbers, slicers, slicer, asked: open } = job.result, [name, setName] = useState(slicer ?? "orcaslicer"), rows = numbers.settings[name];
  const came = ({ value, range }, digits = 2) => `${number(value, digits)} ± ${number(Math.max(range, 0.01), digits)}`;
  return html`<section class="card stack" data-testid="fit"><div class="row between"><h2>${t("fit_title")}</h2><button class="primary" disabled=${Boolean(learning)} onClick=${() => learn({ measurement: job.id })}>${t(learning ? "learning" : "learn")}</button></div>
    <table><thead><tr>${["fit_what", "fit_drawn", "fit_came", "fit_after"].map((one) => html`<th>${t(one)}</th>`)}</tr></thead><tbody>
      ${numbers.layers.map((layer) => html`${layer.holes.map((hole) => html`<tr><td>${t(layer.layer === 1 ? "fit_hole_first" : "fit_hole", { x: number(hole.x_mm, 0), y: number(hole.y_mm, 0) })}</td><td>${number(hole.drawn_mm)}</td><td>${came(hole.came_mm)}</td><td>${number(hole.after_mm[name])}</td></tr>`)}
        <tr><td>${t(layer.layer === 1 ? "fit_outline_first" : "fit_outline")}</td><td /><td>${came(layer.outline_mm)}</td><td /></tr>`)}
      ${numbers.elephants_foot_mm && html`<tr><td>${t("fit_foot")}</td><td /><td>${came(numbers.elephants_foot_mm)}</td><td /></tr>`}
      ${["x", "y"].map((axis) => html`<tr><td>${t(numbers.machine_taken_off ? "fit_shrinks" : "fit_scale", { axis: axis.toUpperCase() })}</td><td /><td>${came({ value: 100 * numbers.shrinkage[axis].value, range: 100 * numbers.shrinkage[axis].range })} %</td><td /></tr>`)}</tbody></table>
    ${!numbers.elephants_foot_mm && html`<p class="note">${t("fit_no_foot")}</p>`}
    <label class="field">${t("fit_slicer")}<select value=${name} onChange=${(event) => setName(event.target.value)}>${Object.entries(slicers).map(([one, title]) => html`<option value=${one}>${title}</option>`)}</select></label>
    <table><tbody>${Object.entries(rows).map(([setting, row]) => html`<tr><td>${row.name} <code>${setting}</code></td><td><b>${row.value}</b></td><td class="faint">${row.is_new ? "" : t("fit_same")}</td></tr>`)}</tbody></table>
    <div class="row">${job.files.filter((file) => /\.(ini|json|curaprofile)$/.test(file)).map((file) => html`<a class="button" href=${fileOf(job, file)} download>${file}</a>`)}</div>
    ${open.length > 0 && html`<p class="note">${t("fit_open")}</p>`}</section>`;
}
