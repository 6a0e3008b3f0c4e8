// Try it: a printer that exists only here, broken with sliders, mended in front of one's eyes.
import { html, useEffect, useRef, useState } from "./vendor.js";
import { beforehand, ended, fileOf, get, mendable, post, STATIC } from "./api.js";
import { Number_, Plate, Pulley, Save, Slice, Wall } from "./drawings.js";
import { inside, Machine } from "./machine.js";
import { Counting, gain, times } from "./moment.js";
import { useTitle } from "./title.js";
import { lights } from "./wrong.js";
import { Problem, Progress, useJob } from "./job.js";
import { Part } from "./part.js";
import PRESETS from "./presets.js";
import { useScene } from "./scene.js";
import { mm, number, said as say, t } from "./words.js";

const STEPS = ["print", "scan", "measure", "learn", "mend"], TOWER = [...STEPS.slice(0, 4), "tower", "mend"];
const FROM = [-0.22, -0.85, 0.9]; // the plate's holes are seen round, or not
const headed = (text) => text[0].toUpperCase() + text.slice(1);
const same = (a, b) => JSON.stringify(a) === JSON.stringify(b);

function Slider({ label, value, unit, max, min = 0, step, digits, onInput, disabled }) {
  return html`<label class="field"><span>${label}<span class="value">${number(value, digits)} ${unit}</span></span>
    <input type="range" min=${min} max=${max} step=${step} value=${value} disabled=${disabled} onInput=${(event) => onInput(Number(event.target.value))} /></label>`;
}

function Motor({ name, values, outline, radius, onChange }) {
  const set = (key) => (value) => onChange({ ...values, [key]: value });
  const shape = (event) => onChange({ ...values, shape: event.target.value, dent_mm: event.target.value === "round" ? 0 : values.dent_mm || 0.8 });
  return html`<section class="card stack"><h2>${t("motor", { name })}</h2>
    <div class="side">
      ${outline ? html`<${Pulley} outline=${outline} radius=${radius} name=${t("motor", { name })} />` : html`<div></div>`}
      <div class="stack">
        <label class="field"><span>${t("shape")}</span><select value=${values.shape} onChange=${shape}>
          ${["round", "eccentric", "oval", "flat", "square"].map((one) => html`<option value=${one}>${t(`shape_${one}`)}</option>`)}</select></label>
        ${values.shape !== "round" && html`<${Slider} label=${t("dent")} value=${values.dent_mm} unit="mm" max="1.5" step="0.01" digits=${2} onInput=${set("dent_mm")} />
          <${Slider} label=${t("angle")} value=${values.angle_deg} unit="°" max="360" step="1" digits=${0} onInput=${set("angle_deg")} />`}
        <${Slider} label=${t("slack")} value=${values.play_mm} unit="mm" max="0.8" step="0.01" digits=${2} onInput=${set("play_mm")} />
      </div>
    </div></section>`;
}

// Effects by their names, each with a slider for each of its numbers; those of other packages come by themselves.
function Effects({ chosen, onChange }) {
  const [all, setAll] = useState(null);
  useEffect(() => { let here = true; get("/play/effects").then((told) => here && setAll(told.effects), () => {}); return () => { here = false; }; }, []);
  if (!all) return null;
  const put = (at, row) => onChange(chosen.map((one, i) => (i === at ? row : one)));
  const add = (event) => {
    const card = all.find((one) => one.name === event.target.value);
    event.target.value = "";
    if (card) onChange([...chosen, { name: card.name, on: card.on[0] ?? null, values: Object.fromEntries(card.sliders.map(({ key, value }) => [key, value])) }]);
  };
  const groups = [...new Set(all.map((one) => one.of))];
  return html`<section class="card stack"><h2>${t("more_faults")}</h2>
    ${chosen.map((row, at) => { const card = all.find((one) => one.name === row.name); return card && html`<div class="stack" key=${`${row.name}-${at}`}>
      <div class="row between" style=${{ flexWrap: "nowrap" }}><h3>${headed(say(card.title))}</h3><button class="quiet" aria-label=${`${t("remove")}: ${say(card.title)}`} onClick=${() => onChange(chosen.filter((_, i) => i !== at))}>×</button></div>
      ${card.on.length > 0 && html`<div class="segment" role="group" aria-label=${t("at_axis")}>${card.on.map((axis) => html`<button aria-pressed=${row.on === axis} onClick=${() => put(at, { ...row, on: axis })}>${axis.toUpperCase()}</button>`)}</div>`}
      ${card.sliders.map((one) => { const set = (value) => put(at, { ...row, values: { ...row.values, [one.key]: value } }); return one.choices.length
        ? html`<label class="field"><span>${say(one.label)}</span><select value=${row.values[one.key]} onChange=${(event) => set(one.choices[event.target.selectedIndex])}>${one.choices.map((choice) => html`<option value=${choice}>${choice}</option>`)}</select></label>`
        : html`<${Slider} label=${say(one.label)} value=${row.values[one.key]} unit=${one.unit} min=${one.low} max=${one.high} step=${one.step} digits=${one.step < 0.01 ? 3 : one.step < 1 ? 2 : 0} onInput=${set} />`; })}</div>`; })}
    ${chosen.length < 12 && html`<label class="field"><span>${t("add_fault")}</span><select value="" onChange=${add}><option value="">…</option>
      ${groups.map((of) => html`<optgroup label=${say(of)}>${all.filter((one) => one.of === of).map((one) => html`<option value=${one.name} disabled=${!one.possible}>${headed(say(one.title))}</option>`)}</optgroup>`)}</select></label>`}
  </section>`;
}

export function Play() {
  useTitle(t("play"));
  const [faults, setFaults] = useState(PRESETS.day), [shown, setShown] = useState(null), [error, setError] = useState(null);
  const [key, setKey] = useState(null), [what, setWhat] = useState("part"), [enlarge, setEnlarge] = useState(5);
  const job = useJob(key), busy = useRef(false), next = useRef(null);
  useEffect(() => { // one question at a time; the newest waits
    const ask = async (wanted) => {
      if (busy.current) { next.current = wanted; return; }
      busy.current = true;
      try { setShown(await post("/play/preview", wanted)); setError(null); } catch (problem) { setError(problem.message); }
      busy.current = false;
      if (next.current) { const then = next.current; next.current = null; ask(then); }
    };
    ask(faults);
  }, [faults]);
  const change = (value) => {
    setFaults(value);
    if (value.screw_mm !== faults.screw_mm) setWhat(value.screw_mm ? "wall" : "part"); else if (what === "wall") setWhat("part");
    if (ended(job) || !key) setKey(null);
  };
  const start = async () => {
    try { setKey((await post("/play", faults)).id); setError(null); } catch (problem) { setError(problem.message); }
  };
  const has = (name) => job?.files?.includes(name);
  const done = job?.state === "done", running = key && !ended(job);
  const [scene, lost] = useScene(done ? job : null, FROM);
  useEffect(() => { if (job?.state === "failed") setError(job.error); else if (job?.state === "done") setError(null); }, [job?.state]);
  const result = done ? job.result : null;
  return html`<div class="head"><div><h1>${t("play_title")}</h1><p class="now">${t(done && scene ? "now_mended" : running && (!STATIC || beforehand(faults)) ? "play_works" : "play_now")}</p></div>
      ${done ? html`<button class="big" onClick=${() => setKey(null)}>${t("change")}</button>`
        : html`<button class="primary big" disabled=${running || !mendable(faults)} onClick=${start}>${running ? t("mending") : t("mend_it")}</button>`}</div>
    <${Problem} error=${error ?? lost} />${STATIC && html`<p class="note">${t(beforehand(faults) ? "static_now" : "static_own")}</p>`}
    <div class="split ${running ? "" : "first"}">
      <div class="stack">
        ${result ? html`<${Result} result=${result} played=${key} />` : running ? html`<section class="card"><${Progress} job=${job ?? { state: "queued", share: 0, id: key }} steps=${faults.screw_mm ? TOWER : STEPS} /></section>` : html`
          <div class="chips" role="group" aria-label=${t("play_title")}>${Object.entries(PRESETS).map(([name, preset]) => html`<button class="chip" aria-pressed=${same(faults, preset)} onClick=${() => change(preset)}>${t(`preset_${name}`)}</button>`)}</div>
          <${Motor} name="X" values=${faults.x} outline=${shown?.outlines_mm[0]} radius=${shown?.radii_mm[0]} onChange=${(x) => change({ ...faults, x })} />
          <${Motor} name="Y" values=${faults.y} outline=${shown?.outlines_mm[1]} radius=${shown?.radii_mm[1]} onChange=${(y) => change({ ...faults, y })} />
          <section class="card stack"><h2>${t("frame")}</h2><${Slider} label=${t("skew")} value=${faults.skew_deg} unit="°" min="-2" max="2" step="0.05" digits=${2} onInput=${(skew_deg) => change({ ...faults, skew_deg })} />
            <${Slider} label=${t("screw")} value=${faults.screw_mm} unit="mm" max="0.5" step="0.01" digits=${2} onInput=${(screw_mm) => change({ ...faults, screw_mm })} /></section>
          ${!STATIC && html`<${Effects} chosen=${faults.effects ?? []} onChange=${(effects) => { const { effects: _, ...rest } = faults; change(effects.length ? { ...rest, effects } : rest); }} />`}`}
      </div>
      <div class="stack">
        ${scene && result ? html`<${Part} scene=${scene} name="printmend" morph=${scene.mended ? 2 : 1} moment share=${{ numbers: { before_mm: result.before.rms_mm, after_mm: result.after.rms_mm }, printer: t("card_play"), part: t("card_plate") }} /><p class="faint">${t(result?.refused || result?.before.rms_mm < 0.002 ? "play_healthy" : "aligned")}</p>`
          : html`<div class="stage">
            ${running && has("seen.jpg") && what === "plate" ? html`<img alt=${t("step_scan")} src=${fileOf(job, "seen.jpg")} style=${{ width: "100%", height: "100%", objectFit: "contain" }} />`
              : !shown ? html`<p class="soon" role="status">${t("drawing")}</p>` : (what === "plate" ? html`<${Plate} id="drawing" marks=${shown.marks_mm} errors=${shown.errors_mm} big=${shown.big} bed=${shown.bed_mm} enlarge=${enlarge} />`
                : what === "wall" ? html`<${Wall} id="drawing" wall=${shown.wall_mm} />` : html`<${Slice} id="drawing" wanted=${shown.part_mm} printed=${shown.printed_mm} joined=${shown.joined} />`)}
            <div class="over"><div class="segment" role="group" aria-label=${t("plate")}>${["part", "plate", ...(faults.screw_mm ? ["wall"] : [])].map((one) => html`<button aria-pressed=${what === one} onClick=${() => setWhat(one)}>${t(one)}</button>`)}</div>
              <${Save} id="drawing" name=${what} /></div>
            <div class="under"><div class="glass row"><span class="key kw">${t("wanted")}</span><span class="key kp">${t("printed")}</span>
              ${what === "plate" && html`<label class="row">${t("enlarge")}<select style=${{ width: "auto", minHeight: "2rem", padding: "0.2rem 0.5rem" }} value=${enlarge} onChange=${(event) => setEnlarge(Number(event.target.value))}>${[1, 2, 5, 10, 20].map((k) => html`<option value=${k}>${k} ×</option>`)}</select></label>`}</div>
              ${shown && html`<div class="glass"><b>${mm(what === "wall" ? Math.hypot(...shown.wall_mm.map(([, push]) => push)) / Math.sqrt(shown.wall_mm.length) : what === "part" ? shown.part_rms_mm : shown.rms_mm)} mm</b> ${t(what === "part" ? "off_layer" : "off")}</div>`}</div></div>`}
      </div>
    </div>`;
}

function Result({ result, played }) {
  const [lit, light] = useState(null), { before, after, said } = result, more = gain(before.rms_mm, after.rms_mm), larger = said ? inside(said.machine) : 1;
  return html`<section class="card stack tally"><div class="numbers">
      <${Number_} value=${mm(before.rms_mm)}>${t("before")}</${Number_}><${Counting} from=${before.rms_mm} to=${after.rms_mm}>${t("after")}</${Counting}>
      ${!result.refused && more > 1.5 && html`<${Counting} from=${1} to=${more} unit="" show=${times}>${t("better")}</${Counting}>`}</div></section>
    ${!said ? html`<section class="card stack"><h2>${t("static_title")}</h2><p class="soft">${t("static_known")}</p></section>` : html`<section class="card stack"><h2>${t("found")}</h2>
      <div class="picture"><${Machine} machine=${said.machine} larger=${larger} label=${larger > 1 ? t("machine", { n: larger }) : t("machine_sound")} faults=${said.faults.map((fault) => fault.part)} lit=${lit} light=${light} played=${played} /></div><p class="faint">${t("light_up")}</p>
      ${said.faults.length ? said.faults.map((fault) => html`<div ...${lights(fault, lit, light)}><h3>${say(fault.title)}</h3><p class="faint">${say(fault.meaning)}</p></div>`) : html`<p>${say(said.headline)}</p>`}</section>`}`;
}
