// My printers: what they are and how they are; and the way through one of them.
import { html, useEffect, useRef, useState } from "./vendor.js";
import { get, patch, post, remove, upload } from "./api.js";
import { ask } from "./ask.js";
import { Drop } from "./drop.js";
import { Problem, useProblem } from "./job.js";
import { Machine } from "./machine.js";
import { Measure } from "./measure.js";
import { GhostPart, Mend } from "./mend.js";
import { GhostHistory, Prove } from "./prove.js";
import { useTitle } from "./title.js";
import { day, mm, sentence, t, typed } from "./words.js";
import { Wrong } from "./wrong.js";

const TABS = { measure: Measure, wrong: Wrong, mend: Mend, prove: Prove };
// What will be on a screen that the test print comes before.
const SOON = { wrong: ({ printer }) => html`<${Machine} id="ghost" machine=${printer} label=${printer.name} />`, mend: GhostPart, prove: GhostHistory };

export function Printers({ at }) {
  if (at[0] === "new") return html`<${New} />`;
  return at[0] ? html`<${Printer} key=${at[0]} id=${at[0]} tab=${at[1]} more=${at[2]} />` : html`<${List} />`;
}

function List() {
  const [printers, setPrinters] = useState(null), [error, setError] = useState(null);
  useTitle(t("printers"));
  const [shared, setShared] = useState(false);
  useEffect(() => { get("/health").then((health) => setShared(health.shared), () => {}); }, []);
  useEffect(() => { get("/printers").then(setPrinters, (problem) => setError(problem.message)); }, []);
  return html`<div class="head"><div><h1>${t("printers")}</h1><p class="now">${t("printers_now")}</p></div><div class="row">${shared && html`<a class="button quiet" href="#/devices">${t("devices")}</a>`}<a class="button quiet" href="#/storage">${t("storage")}</a><a class="button primary big" href="#/printers/new">${t("new_printer")}</a></div></div>
    <${Problem} error=${error} />
    <div class="grid">${printers?.map((one) => html`<a class="card pcard" href="#/printers/${one.id}/${one.digest ? "mend" : "measure"}">
      <div class="row between"><h2>${one.name}</h2><span class="dot ${one.healthy === null ? "" : one.healthy ? "good" : "bad"}"></span></div>
      <div class="pthumb"><${Machine} id=${`machine-${one.id}`} machine=${one} label=${one.name} faults=${one.parts} small />${one.trend.length > 0 && html`<div class="number"><b>${mm(one.trend.at(-1))} <small>mm</small></b><span>${t("before_model")}</span></div>`}</div>
      <p class="soft">${one.health === null ? t("now_measure") : one.healthy ? t("healthy") : sentence(one.health)}</p>
      <div class="row between faint"><span>${one.measured_s ? t("measured_on", { day: day(one.measured_s) }) : t("not_measured")}</span><${Trend} values=${one.trend} /></div></a>`)}${printers?.length === 0 && html`<${Ghost} />`}</div>`;
}

// What a card will look like, where there is none yet.
const Ghost = () => html`<div class="card pcard ghost"><div class="row between"><h2>${t("ghost_name")}</h2></div><div class="pthumb"><${Machine} id="ghost" machine=${{ kinematics: "cartesian", bed_mm: [0, 0, 220, 220] }} label=${t("ghost_name")} faults=${["x"]} small /><div class="number"><b>${mm(0.31)} <small>mm</small></b><span>${t("before_model")}</span></div></div><p class="soft">${t("ghost_says")}</p></div>`;

function Trend({ values }) {
  if (values.length < 2) return null;
  const most = Math.max(...values, 0.01), step = 60 / (values.length - 1);
  return html`<svg width="64" height="22" viewBox="-2 -2 64 22" aria-hidden="true"><polyline class="p" stroke-width="2" points=${values.map((v, i) => `${i * step},${18 - (18 * v) / most}`).join(" ")} /></svg>`;
}

function New() {
  const [presets, setPresets] = useState([]), [like, setLike] = useState("ender3"), [name, setName] = useState(""), [error, setError] = useState(null);
  const [bed, setBed] = useState(null), [file, setFile] = useState(null), [busy, setBusy] = useState(false);
  useTitle(t("new_printer"));
  useEffect(() => { get("/presets").then(setPresets, (problem) => setError(problem.message)); }, []);
  const preset = presets.find((one) => one.id === like);
  const size = bed ?? (preset ? [preset.bed_mm[2] - preset.bed_mm[0], preset.bed_mm[3] - preset.bed_mm[1]] : [220, 220]);
  const add = async () => {
    setBusy(true);
    try {
      const sent = file ? (await upload(file)).id : null;
      const made = await post("/printers", { name, preset: like, upload: sent, bed_mm: file ? null : bed });
      location.hash = `#/printers/${made.id}/measure`;
    } catch (problem) { setError(problem.message); setBusy(false); }
  };
  return html`<div class="head"><div><h1>${t("new_printer")}</h1><p class="now">${t("new_now")}</p></div></div><${Problem} error=${error} />
    <div class="split"><section class="card stack">
        <label class="field">${t("name")}<input value=${name} maxlength="80" placeholder=${preset?.name ?? ""} onInput=${(event) => setName(event.target.value)} /></label>
        <label class="field">${t("like")}<select value=${like} onChange=${(event) => { setLike(event.target.value); setBed(null); }}>${presets.map((one) => html`<option value=${one.id}>${one.name}</option>`)}</select></label>
        ${file ? html`<p class="note row between"><span>${t("from_file", { name: file.name })}</span><button class="quiet" onClick=${() => setFile(null)}>${t("remove")}</button></p>`
          : html`<${Drop} accept=".cfg,.ini,.json,.toml" onFiles=${([one]) => setFile(one)}><p>${t("describe")}</p></${Drop}>`}
        <button class="primary" disabled=${busy || !preset} onClick=${add}>${t("add")}</button></section>
      ${!file && html`<section class="card stack"><h2>${t("bed")}</h2><${Bed} size=${size} room=${preset ? [preset.bed_mm[2], preset.bed_mm[3]] : size} onChange=${setBed} />
        <div class="row">${["width", "depth"].map((side, i) => html`<label class="field">${t(side)}, mm<input inputmode="decimal" value=${Math.round(size[i])} onChange=${(event) => { const value = typed(event.target.value); if (value >= 30 && value <= 2000) setBed(size.map((old, j) => (i === j ? value : old))); }} /></label>`)}</div></section>`}</div>`;
}

// The bed from above; its corner can be dragged.
function Bed({ size, room, onChange }) {
  const svg = useRef(), reach = Math.max(...room, ...size) * 1.16;
  const drag = (event) => {
    if (!event.buttons) return;
    const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.current.getScreenCTM().inverse());
    onChange([x, reach - y].map((v) => Math.min(1000, Math.max(60, Math.round(v / 5) * 5))));
  };
  const lines = [];
  for (let x = 10; x < size[0]; x += 10) lines.push(`M${x} ${reach}V${reach - size[1]}`);
  for (let y = 10; y < size[1]; y += 10) lines.push(`M0 ${reach - y}H${size[0]}`);
  return html`<svg ref=${svg} viewBox="${-reach / 80} 0 ${reach * (1 + 1 / 80)} ${reach * (1 + 1 / 80)}" style=${{ width: "100%", maxHeight: "52vh", touchAction: "none" }} role="img" aria-label=${`${t("bed")} ${size[0]} × ${size[1]} mm`} onPointerMove=${drag}>
    <rect y=${reach - size[1]} width=${size[0]} height=${size[1]} rx="4" fill="var(--well)" stroke="var(--accent)" stroke-width="1.5" vector-effect="non-scaling-stroke" /><path d=${lines.join("")} class="axis" />
    <circle cx=${size[0]} cy=${reach - size[1]} r="7" fill="var(--accent)" style=${{ cursor: "nesw-resize" }} onPointerDown=${(event) => event.target.releasePointerCapture?.(event.pointerId)} /></svg>`;
}

function Printer({ id, tab = "measure", more }) {
  const [printer, setPrinter] = useState(null), [error, tried] = useProblem(), [naming, setNaming] = useState(null), [told, tell] = useState(null);
  const load = () => tried(async () => setPrinter(await get(`/printers/${id}`)));
  useEffect(() => { load(); }, [id]);
  const shown = TABS[tab] ? tab : "measure", Screen = TABS[shown], Soon = SOON[shown];
  const away = async () => { if (await ask(t("remove_sure", { name: printer.name }), t("remove"))) await tried(async () => { await remove(`/printers/${id}`); location.hash = "#/printers"; }); };
  const rename = (event) => { event.preventDefault(); tried(async () => { setPrinter(await patch(`/printers/${id}`, { name: naming })); setNaming(null); }); };
  useTitle(t(`tab_${shown}`), printer?.name);
  if (!printer) return html`<${Problem} error=${error} />`;
  const first = shown !== "measure" && (!printer.digest || (shown === "prove" && !printer.has_probe)); // something comes before this screen
  return html`<div class="head"><div>${naming === null ? html`<h1>${printer.name}</h1>` : html`<form class="row" onSubmit=${rename}><input aria-label=${t("name")} value=${naming} maxlength="80" style=${{ width: "18rem" }} onInput=${(event) => setNaming(event.target.value)} /><button class="primary">${t("rename")}</button></form>`}
        <p class="now">${t(told ?? (shown === "measure" && !printer.has_probe ? "measure_first" : `${shown}_${!first ? "now" : printer.digest ? "make" : "none"}`))}</p></div>
      <div class="row"><button class="quiet" onClick=${() => setNaming(naming === null ? printer.name : null)}>${t("rename")}</button><button class="quiet" onClick=${away}>${t("remove")}</button></div></div>
    <nav class="tabs" aria-label=${printer.name}>${Object.keys(TABS).map((name) => html`<a href="#/printers/${id}/${name}" aria-current=${name === shown ? "page" : undefined}>${t(`tab_${name}`)}</a>`)}</nav>
    <${Problem} error=${error} />
    ${first ? html`<div class="stage ghost"><${Soon} printer=${printer} /><div class="soon"><a class="button primary big" href="#/printers/${id}/measure">${t("to_measure")}</a></div></div>` : html`<${Screen} printer=${printer} changed=${load} more=${more} tell=${tell} />`}`;
}
