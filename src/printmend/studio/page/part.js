// The part on a stage: the three-dimensional view with its slider, layers, colours and pictures. Without a scene the stage
// is empty and all is ready for one; `children` are laid over it.
import { html, useEffect, useRef, useState } from "./vendor.js";
import { Cut } from "./cut.js";
import { Save, saveBlob } from "./drawings.js";
import { Share } from "./card.js";
import { Wipe } from "./moment.js";
import { mm, number, t } from "./words.js";
import { scaleOf } from "./scene.js";
import { vector } from "./vector.js";
import { View } from "./view3d.js";

const PLACES = [["wanted", 0], ["printed", 1], ["mended", 2]];

// With `share` {numbers, printer, part} it can be sent to a friend; `moment` begins with the wipe.
export function Part({ scene, bed, name = "part", morph: start, busy = false, share, moment = false, children }) {
  const canvas = useRef(), view = useRef();
  const [failed, setFailed] = useState(false), [morph, setMorph] = useState(start ?? 1), [enlarge, setEnlarge] = useState(1);
  const [wipe, setWipe] = useState(null), [top, setTop] = useState(0), [single, setSingle] = useState(false), [cut, setCut] = useState(false);
  const last = (scene?.layers.length ?? 1) - 1, scale = scaleOf(scene), { most, fine } = scale;
  useEffect(() => {
    try { view.current = new View(canvas.current, { onFrame: (ms, fine) => { if (canvas.current) Object.assign(canvas.current.dataset, { frame: ms.toFixed(1), fine, pictures: Number(canvas.current.dataset.pictures ?? 0) + 1 }); } }); } catch { setFailed(true); }
    return () => { view.current?.close(); view.current = null; };
  }, []);
  useEffect(() => {
    if (!scene) {
      view.current?.empty();
      for (const name of ["frame", "fine", "pictures"]) delete canvas.current.dataset[name];
      return;
    }
    view.current?.show(scene, bed);
    setTop(last);
    setSingle(false);
    view.current?.set({ most, fine, doubt: scene.doubt ?? [0, 0] });
  }, [scene]);
  useEffect(() => { view.current?.wait(busy); }, [busy]);
  useEffect(() => { if (start !== undefined) setMorph(start); setWipe(moment && scene?.mended ? 1 : null); }, [start, scene]);
  useEffect(() => { view.current?.wipeAt(scene?.mended ? wipe : null); }, [wipe, scene]);
  useEffect(() => { view.current?.set({ morph, enlarge, tinted: morph > 0.02 ? 1 : 0 }); }, [morph, enlarge, scene]);
  useEffect(() => { if (scene && single) view.current?.aim(scene.layers[Math.min(top, last)][2]); }, [single, top]);
  useEffect(() => { if (scene && !single) view.current?.aim((scene.low_mm[2] + scene.high_mm[2]) / 2); }, [single]);
  useEffect(() => { if (scene) view.current?.layers(single ? Math.min(top, last) : 0, Math.min(top, last)); }, [top, single, scene]);
  const key = (event) => {
    const turn = { ArrowLeft: [-0.15, 0], ArrowRight: [0.15, 0], ArrowUp: [0, 0.12], ArrowDown: [0, -0.12], "+": [0, 0, 1.15], "=": [0, 0, 1.15], "-": [0, 0, 1 / 1.15] }[event.key];
    const layer = { PageUp: 1, PageDown: -1 }[event.key];
    if (turn) view.current?.turn(...turn);
    if (layer) setTop((now) => Math.min(last, Math.max(0, now + layer)));
    if (turn || layer) event.preventDefault();
  };
  const save = async (kind) => saveBlob(kind === "png" ? await view.current.picture() : new Blob([vector(view.current)], { type: "image/svg+xml" }), `${name}.${kind}`);
  const places = scene?.mended ? PLACES : PLACES.slice(0, 2), height = scene?.layers[Math.min(top, last)]?.[2] ?? 0, says = t("layer", { n: Math.min(top, last) + 1, of: last + 1, z: number(height, 2) });
  return html`<div class="stage" data-testid="part">
    ${failed && html`<p class="problem" style=${{ margin: "5rem 1rem" }}>${t("no_gl")}</p>`}
    <canvas ref=${canvas} tabindex=${scene ? 0 : undefined} role="img" aria-label=${t("view")} onKeyDown=${key}></canvas>
    ${children}
    ${scene && html`<div class="over">
      <div class="segment" role="group" aria-label=${t("morph")}>
        ${places.map(([place, at]) => html`<button aria-pressed=${wipe === null && Math.abs(morph - at) < 0.3} onClick=${() => { setWipe(null); setMorph(at); }}>${t(place)}</button>`)}
        ${scene.mended && html`<button aria-pressed=${wipe !== null} onClick=${() => { setMorph(2); setWipe(1); }}>${t("compare")}</button>`}
      </div>
      <div class="row">
        <button class="quiet glass" onClick=${() => { view.current?.fit([0, -0.01, 1]); view.current?.draw(); }}>${t("view_top")}</button>
        <button class="quiet glass" onClick=${() => { setTop(last); setSingle(false); view.current?.fit(); view.current?.draw(); }}>${t("reset")}</button>
        <button class="quiet glass" aria-pressed=${cut} onClick=${() => setCut(!cut)}>${t("cut_show")}</button>
        <${Save} save=${save} />
        ${scene.mended && share && html`<${Share} ...${share} scene=${scene} name=${name} shots=${(...size) => view.current.shots(...size)} />`}
      </div>
    </div>
    ${scene.mended && wipe !== null && html`<${Wipe} at=${wipe} onMove=${setWipe} />`}
    <div class="layers"><input type="range" min="0" max=${last} value=${Math.min(top, last)} aria-label=${says}
      onInput=${(event) => setTop(Number(event.target.value))} /></div>
    <div class="under">
      <div class="glass scale" hidden=${morph <= 0.02}><i class=${fine ? "fine" : ""}></i><span><b>0</b><b>${fine ? number(fine, 3) : number(most / 2, most < 0.1 ? 3 : 2)}</b><b>≥ ${mm(most)}</b></span><span>${t(scene.doubt ? "colour_expected" : "colour")}${fine ? html`<br />${t("colour_fine", { fine: number(fine, 3) })}` : ""}</span></div>
      <div class="glass row">
        <span>${says}</span>
        <label class="row"><input type="checkbox" checked=${single} onChange=${(event) => setSingle(event.target.checked)} />${t("one_layer")}</label>
        <label class="row">${t("enlarge")}<select value=${enlarge} style=${{ width: "auto", minHeight: "2rem", padding: "0.2rem 0.5rem" }} onChange=${(event) => setEnlarge(Number(event.target.value))}>${[1, 2, 5, 10, 20].map((k) => html`<option value=${k}>${k} ×</option>`)}</select></label>
      </div>
    </div>`}
  </div>
  ${scene && html`<label class="field"><span class="sr">${t("morph")}</span>
    <input type="range" min="0" max=${scene.mended ? 2 : 1} step="0.01" value=${morph} onInput=${(event) => { setWipe(null); setMorph(Number(event.target.value)); }} /><span class="row between faint" aria-hidden="true">${places.map(([place]) => html`<span>${t(place)}</span>`)}</span></label>
  ${cut && html`<${Cut} scene=${scene} morph=${morph} scale=${scale} name=${name} />`}
  ${scene.every > 1 && !scene.coarse && html`<p class="faint">${t("every", { n: scene.every })}</p>`}`}`;
}
