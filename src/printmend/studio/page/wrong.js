// What is wrong: the machine drawn as it is, its faults made larger, and words beside them.
import { html, useEffect, useState } from "./vendor.js";
import { get } from "./api.js";
import { Number_, Save, ticks, wide } from "./drawings.js";
import { Problem } from "./job.js";
import { Pair } from "./send.js";
import { inside, Machine } from "./machine.js";
import { mm, number, said as say, sentence, t } from "./words.js";

export function Wrong({ printer }) {
  const [known, setKnown] = useState(null), [error, setError] = useState(null), [chosen, setLarger] = useState(null), [lit, light] = useState(null);
  useEffect(() => { get(`/printers/${printer.id}/known`).then(setKnown, (problem) => setError(problem.message)); }, [printer.id]);
  const said = known?.said;
  if (!known) return html`<${Problem} error=${error} />`;
  if (!said) return null;
  const sound = !said.faults.length, graded = said.misfit.map((line) => /^(?:(\w+): )?(.*)$/s.exec(line));
  const refused = graded.some(([, grade]) => grade === "refusal"), doubted = refused || graded.some(([, grade]) => grade === "warning");
  const larger = refused ? 1 : chosen ?? inside(said.machine);
  return html`<div class="split"><div class="stack">
      <section class="card stack"><h2>${t("found")}</h2>${said.before_mm != null && html`<div class="numbers"><${Number_} value=${mm(said.before_mm)}>${t("before_model")}</${Number_}><${Number_} value=${mm(said.after_mm)}>${t("after_model")}</${Number_}><${Number_} value=${said.measured} unit="">${t("points")}</${Number_}></div>`}
        ${said.faults.length ? said.faults.map((fault) => html`<${Fault} fault=${fault} lit=${lit} light=${light} />`) : html`<p>${said.learner === "callipers" ? say(said.headline) : t(doubted ? "nothing_known" : "nothing_wrong")}</p>`}
        ${graded.map(([, grade, words]) => html`<p class=${{ refusal: "problem", warning: "note" }[grade] ?? "faint"}>${sentence(words)}</p>`)}</section>
      ${said.gaps.length > 0 && html`<section class="card stack"><h2>${t("gaps")}</h2>${said.gaps.map((gap) => html`<p class="soft">${sentence(gap)}</p>`)}<${Next} printer=${printer} /></section>`}
      ${!refused && html`<${Pair} printer=${printer} />`}
      <a class="button primary" href=${`#/printers/${printer.id}/${refused ? "measure" : "mend"}`}>${t(refused ? "next_measure" : sound && !doubted ? "next_look" : "next_mend")}</a></div>
    <div class="stack"><div class=${refused ? "stage refused" : "stage"}><${Machine} machine=${said.machine} larger=${larger} label=${words(refused, sound, larger)} faults=${said.faults.map((fault) => fault.part)} lit=${lit} light=${light} />
        <div class="over"><div class="glass"><b>${words(refused, sound, larger)}</b></div><${Save} id="machine" name="machine" /></div></div>
      ${!sound && !refused && html`<div class="row between"><p class="faint" style=${{ flex: "1 1 16rem" }}>${t("drawn_belts")}</p><label class="field" style=${{ flex: "1 1 16rem" }}><span>${t("enlarge")}<span class="value">${larger} ×</span></span><input type="range" min="1" max="50" value=${larger} onInput=${(event) => setLarger(Number(event.target.value))} /></label></div>`}
      ${said.machine.motors.map((motor) => html`<section class="card stack"><div class="row between"><h3>${t("curve", { name: motor.name })}</h3><div class="row"><span class="key km">${t("forwards")}</span><span class="key kp">${t("backwards")}</span><${Save} id=${`curve-${motor.name}`} name=${`curve-${motor.name}`} /></div></div><${Curve} motor=${motor} /></section>`)}</div></div>`;
}

const words = (refused, sound, larger) => (refused ? t("machine_refused") : sound || larger === 1 ? t("machine_sound") : t("machine", { n: larger }));

// The cheapest print that would show what is missing.
function Next({ printer }) {
  const [next, setNext] = useState(null);
  useEffect(() => { get(`/printers/${printer.id}/next`).then(setNext, () => {}); }, [printer.id, printer.digest]);
  return next && html`<p><b>${t("next_print", { size: number(next.size_mm, 0), minutes: number(next.minutes, 0), grams: number(next.grams, 1), mm: mm(next.expected_mm) })}</b></p>
    <a class="button" href=${`#/printers/${printer.id}/measure/${Math.round(next.size_mm)}`}>${t("next_make")}</a>`;
}

// What lights a part of the picture while one looks at its sentence, and is lit while one looks at the part.
export const lights = (fault, lit, light) => ({ tabindex: 0, "data-fault": fault.part, onMouseEnter: () => light(fault.part), onMouseLeave: () => light(null), onFocus: () => light(fault.part), onBlur: () => light(null), class: `fault ${fault.urgency} ${lit === fault.part ? "lit" : ""}` });

function Fault({ fault, lit, light }) {
  return html`<div ...${lights(fault, lit, light)}><div class="row between"><h3>${say(fault.title)}</h3><span class="tag">${t(`urgency_${fault.urgency}`)}</span></div>
    <p>${say(fault.meaning)}</p><p class="faint">${t("how_sure")}: ${say(fault.sure)}</p><p class="faint">${t("to_do")}: ${say(fault.repair)}</p><p class="faint">${t("software")}: ${say(fault.software)}</p></div>`;
}

const path = (points) => points.map(([x, y], i) => `${i ? "L" : "M"}${x.toFixed(2)} ${y.toFixed(2)}`).join("");

function Curve({ motor }) {
  const { at_mm: at, forwards_mm: a, backwards_mm: b } = motor, low = Math.min(...a, ...b), high = Math.max(...a, ...b), pad = Math.max((high - low) * 0.08, 0.01);
  const W = wide(), H = 190, left = 46, right = 16, bottom = 22, x = (v) => left + ((v - at[0]) / (at.at(-1) - at[0])) * (W - left - right), y = (v) => 6 + ((high + pad - v) / (high - low + 2 * pad)) * (H - bottom - 12);
  const line = (values) => path(values.map((v, i) => [x(at[i]), y(v)]));
  return html`<svg id=${`curve-${motor.name}`} viewBox="0 0 ${W} ${H}" style=${{ width: "100%" }} role="img" aria-label=${t("curve", { name: motor.name })}>${ticks(low - pad, high + pad, 6).map(([v, text]) => html`<g><path d=${`M${left} ${y(v)}H${W - right}`} class="axis" /><text x=${left - 6} y=${y(v) + 4} text-anchor="end">${text}</text></g>`)}
    ${ticks(at[0], at.at(-1), 5).map(([v, text]) => html`<text x=${x(v)} y=${H - 4} text-anchor="middle">${text}</text>`)}
    <path d=${line(a)} class="m" stroke-width="1.8" /><path d=${line(b)} class="p" stroke-width="1.8" /></svg>`;
}
