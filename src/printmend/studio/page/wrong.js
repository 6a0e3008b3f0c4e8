// What is wrong: the machine drawn as it is, its faults made larger, and words beside them.
import { html, useEffect, useState } from "./vendor.js";
import { get } from "./api.js";
import { Number_, Save, wide } from "./drawings.js";
import { Problem } from "./job.js";
import { mm, number, said as say, sentence, t } from "./words.js";

export function Wrong({ printer }) {
  const [known, setKnown] = useState(null), [error, setError] = useState(null), [chosen, setLarger] = useState(null);
  useEffect(() => { get(`/printers/${printer.id}/known`).then(setKnown, (problem) => setError(problem.message)); }, [printer.id]);
  const said = known?.said;
  if (!known) return html`<${Problem} error=${error} />`;
  if (!said) return null;
  const sound = !said.faults.length, graded = said.misfit.map((line) => /^(?:(\w+): )?(.*)$/s.exec(line));
  const refused = graded.some(([, grade]) => grade === "refusal"), doubted = refused || graded.some(([, grade]) => grade === "warning");
  const larger = refused ? 1 : chosen ?? inside(said.machine);
  return html`<div class="split"><div class="stack">
      <section class="card stack"><h2>${t("found")}</h2>${said.before_mm != null && html`<div class="numbers"><${Number_} value=${mm(said.before_mm)}>${t("before_model")}</${Number_}><${Number_} value=${mm(said.after_mm)}>${t("after_model")}</${Number_}><${Number_} value=${said.measured} unit="">${t("points")}</${Number_}></div>`}
        ${said.faults.length ? said.faults.map((fault) => html`<${Fault} fault=${fault} />`) : html`<p>${said.learner === "callipers" ? say(said.headline) : t(doubted ? "nothing_known" : "nothing_wrong")}</p>`}
        ${graded.map(([, grade, words]) => html`<p class=${{ refusal: "problem", warning: "note" }[grade] ?? "faint"}>${sentence(words)}</p>`)}</section>
      ${said.gaps.length > 0 && html`<section class="card stack"><h2>${t("gaps")}</h2>${said.gaps.map((gap) => html`<p class="soft">${sentence(gap)}</p>`)}<${Next} printer=${printer} /></section>`}
      <a class="button primary" href=${`#/printers/${printer.id}/${refused ? "measure" : "mend"}`}>${t(refused ? "next_measure" : sound && !doubted ? "next_look" : "next_mend")}</a></div>
    <div class="stack"><div class=${refused ? "stage refused" : "stage"}><${Machine} machine=${said.machine} larger=${larger} words=${words(refused, sound, larger)} />
        <div class="over"><div class="glass"><b>${words(refused, sound, larger)}</b></div><${Save} id="machine" name="machine" /></div></div>
      ${!sound && !refused && html`<div class="row between"><p class="faint" style=${{ flex: "1 1 16rem" }}>${t("drawn_belts")}</p><label class="field" style=${{ flex: "1 1 16rem" }}><span>${t("enlarge")}<span class="value">${larger} ×</span></span><input type="range" min="1" max="50" value=${larger} onInput=${(event) => setLarger(Number(event.target.value))} /></label></div>`}
      ${said.machine.motors.map((motor) => html`<section class="card stack"><div class="row between"><h3>${t("curve", { name: motor.name })}</h3><div class="row"><span class="key kp">${t("forwards")}</span><span class="key km">${t("backwards")}</span><${Save} id=${`curve-${motor.name}`} name=${`curve-${motor.name}`} /></div></div><${Curve} motor=${motor} /></section>`)}</div></div>`;
}

const words = (refused, sound, larger) => (refused ? t("machine_refused") : sound || larger === 1 ? t("machine_sound") : t("machine", { n: larger }));

// How much larger faults are drawn at first: less than ten times where the bed's net would leave its picture.
function inside({ bed_mm: [x0, y0, x1, y1], net_mm: net, bent_mm: bent }) {
  const most = Math.max(...net.flatMap(([x, y], i) => [Math.abs(bent[i][0] - x), Math.abs(bent[i][1] - y)]), 1e-9);
  return Math.max(1, Math.min(10, Math.floor((0.12 * Math.min(x1 - x0, y1 - y0)) / most)));
}

// The cheapest print that would show what is missing.
function Next({ printer }) {
  const [next, setNext] = useState(null);
  useEffect(() => { get(`/printers/${printer.id}/next`).then(setNext, () => {}); }, [printer.id, printer.digest]);
  return next && html`<p><b>${t("next_print", { size: number(next.size_mm, 0), minutes: number(next.minutes, 0), grams: number(next.grams, 1), mm: mm(next.expected_mm) })}</b></p>
    <a class="button" href=${`#/printers/${printer.id}/measure/${Math.round(next.size_mm)}`}>${t("next_make")}</a>`;
}

function Fault({ fault }) {
  return html`<div class="fault ${fault.urgency}"><div class="row between"><h3>${say(fault.title)}</h3><span class="tag">${t(`urgency_${fault.urgency}`)}</span></div>
    <p>${say(fault.meaning)}</p><p class="faint">${t("how_sure")}: ${say(fault.sure)}</p><p class="faint">${t("to_do")}: ${say(fault.repair)}</p><p class="faint">${t("software")}: ${say(fault.software)}</p></div>`;
}

const grown = (outline, radius, larger) => outline.map(([x, y]) => { const r = Math.hypot(x, y) || 1, to = radius + (r - radius) * larger; return [(x / r) * to, -(y / r) * to]; });
// A pulley made so much larger than this would no longer look like one: then it says its own factor.
const most = ({ outline_mm: outline, radius_mm: radius }) => { const off = Math.max(...outline.map(([x, y]) => Math.abs(Math.hypot(x, y) - radius))); return Math.max(1, Math.floor((0.4 * radius) / Math.max(off, 1e-9))); };
const path = (points) => points.map(([x, y], i) => `${i ? "L" : "M"}${x.toFixed(2)} ${y.toFixed(2)}`).join("");

// From above: the bed's net bent as the frame is, a belt and a pulley for each motor.
function Machine({ machine, larger, words: label }) {
  const [x0, y0, x1, y1] = machine.bed_mm, w = x1 - x0, h = y1 - y0, n = machine.along;
  const at = (i) => { const [a, b] = machine.net_mm[i], [c, d] = machine.bent_mm[i]; return [a + (c - a) * larger, -(b + (d - b) * larger)]; };
  let net = "";
  for (let first = 0; first < machine.net_mm.length; first += n) net += path(Array.from({ length: n }, (_, i) => at(first + i)));
  const scale = Math.min(w, h) / 11, [one, two] = machine.motors;
  const belt = (length, play) => { const sag = Math.min(play * larger * 1.6, scale); return `M0 ${-scale * 0.62}L${length} ${-scale * 0.62}M0 ${scale * 0.62}Q${length / 2} ${scale * 0.62 + 2 * sag} ${length} ${scale * 0.62}`; };
  const drive = (motor, length, place, label) => { const factor = Math.min(larger, most(motor)); return html`<g transform=${place}><path d=${belt(length, motor.play_mm)} fill="none" stroke="var(--soft)" stroke-width="2.2" vector-effect="non-scaling-stroke" /><circle cx=${length} r=${scale * 0.62} fill="var(--card)" stroke="var(--soft)" stroke-width="1.4" vector-effect="non-scaling-stroke" />
    <circle r=${scale * 0.62} fill="none" stroke="var(--wanted)" stroke-dasharray="3 3" vector-effect="non-scaling-stroke" /><g transform=${`scale(${(scale * 0.62) / motor.radius_mm})`}><path d=${path(grown(motor.outline_mm, motor.radius_mm, factor)) + "Z"} fill="var(--accent-soft)" stroke="var(--accent)" stroke-width="2" vector-effect="non-scaling-stroke" /></g><circle r=${scale * 0.09} fill="var(--soft)" /></g><text x=${label[0]} y=${label[1]} text-anchor="middle" style=${{ fontSize: `${scale * 0.4}px`, fontWeight: 600 }}>${motor.name}${factor < larger ? ` ${factor} ×` : ""}</text>`; };
  const pad = scale * 2.9, { screw } = machine;
  const turned = screw ? Math.min(larger, Math.max(1, Math.floor(scale / Math.max(...screw.push_mm.map(([x]) => Math.abs(x)), 1e-9)))) : 1;
  return html`<svg id="machine" class="fill" viewBox="${x0 - pad} ${-y1 - pad * 0.95} ${w + 2 * pad} ${h + 2.1 * pad}" role="img" aria-label=${label}>
    <rect x=${x0} y=${-y1} width=${w} height=${h} rx="5" fill="var(--card)" stroke="var(--line)" vector-effect="non-scaling-stroke" /><path d=${net} class="m" stroke-width="1.2" opacity="0.75" />
    ${screw && html`<g transform=${`translate(${x1 + scale * 1.5} ${-y0})`}><path d=${`M0 0V${-h}`} class="w" stroke-dasharray="3 3" /><path d=${path(screw.at_mm.map((z, i) => [screw.push_mm[i][0] * turned, (-z / screw.at_mm.at(-1)) * h]))} fill="none" stroke="var(--accent)" stroke-width="4" vector-effect="non-scaling-stroke" />
      <rect x=${-scale * 0.4} y=${-h * 0.3} width=${scale * 0.8} height=${scale * 0.5} rx="2" fill="var(--card)" stroke="var(--soft)" vector-effect="non-scaling-stroke" /><text y=${scale * 0.6} text-anchor="middle" style=${{ fontSize: `${scale * 0.4}px`, fontWeight: 600 }}>Z${turned < larger ? ` ${number(turned, 0)} ×` : ""}</text></g>`}
    ${drive(one, w, `translate(${x0} ${-y0 + scale * 1.55})`, [x0, -y0 + scale * 2.75])}${drive(two, h, `translate(${x0 - scale * 1.25} ${-y0}) rotate(-90)`, [x0 - scale * 2.5, -y0 + scale * 0.14])}</svg>`;
}

function Curve({ motor }) {
  const { at_mm: at, forwards_mm: a, backwards_mm: b } = motor, low = Math.min(...a, ...b), high = Math.max(...a, ...b), pad = Math.max((high - low) * 0.08, 0.01);
  const W = wide(), H = 190, left = 46, bottom = 22, x = (v) => left + ((v - at[0]) / (at.at(-1) - at[0])) * (W - left - 8), y = (v) => 6 + ((high + pad - v) / (high - low + 2 * pad)) * (H - bottom - 12);
  const line = (values) => path(values.map((v, i) => [x(at[i]), y(v)]));
  const ticks = high - low < 0.005 ? [low] : [low, (low + high) / 2, high];
  return html`<svg id=${`curve-${motor.name}`} viewBox="0 0 ${W} ${H}" style=${{ width: "100%" }} role="img" aria-label=${t("curve", { name: motor.name })}>${ticks.map((v) => html`<g><path d=${`M${left} ${y(v)}H${W - 8}`} class="axis" /><text x=${left - 6} y=${y(v) + 4} text-anchor="end">${number(v, 2)}</text></g>`)}
    ${[0, 0.25, 0.5, 0.75, 1].map((s) => html`<text x=${x(at[0] + s * (at.at(-1) - at[0]))} y=${H - 4} text-anchor=${s === 1 ? "end" : "middle"}>${number(at[0] + s * (at.at(-1) - at[0]), 0)}</text>`)}
    <path d=${line(a)} class="p" stroke-width="1.8" /><path d=${line(b)} class="m" stroke-width="1.8" /></svg>`;
}
