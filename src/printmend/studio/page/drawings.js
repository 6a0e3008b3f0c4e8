// Flat drawings: pulleys, the test print, a layer of a part. All SVG, so that they can be saved and scale.
import { html } from "./vendor.js";
import { nice, number, t } from "./words.js";

const line = (points) => points.map(([x, y], i) => `${i ? "L" : "M"}${x.toFixed(3)} ${(-y).toFixed(3)}`).join("");

export function Pulley({ outline, radius, name }) {
  const reach = radius * 1.42;
  return html`<svg viewBox="${-reach} ${-reach} ${2 * reach} ${2 * reach}" role="img" aria-label=${name}>
    <circle r=${radius} class="w" stroke-width="1.2" stroke-dasharray="3 3" />
    <path d=${line(outline) + "Z"} fill="var(--accent-soft)" stroke="var(--accent)" stroke-width="2" vector-effect="non-scaling-stroke" />
    <circle r="0.9" fill="var(--card)" stroke="var(--soft)" stroke-width="1.4" vector-effect="non-scaling-stroke" />
    <path d="M-0.4 0H0.4M0 -0.4V0.4" class="axis" />
  </svg>`;
}

// Commanded marks and where they land, enlarged to be seen.
export function Plate({ marks, errors, big, bed, enlarge, id }) {
  const [x0, y0, x1, y1] = bed, pad = 8;
  let ticks = "", dots = "", wanted = "";
  marks.forEach(([x, y], i) => {
    const r = big?.[i] ? 1.15 : 0.75, ex = x + errors[i][0] * enlarge, ey = y + errors[i][1] * enlarge;
    if (!Number.isFinite(ex)) return;
    ticks += `M${x.toFixed(2)} ${(-y).toFixed(2)}L${ex.toFixed(2)} ${(-ey).toFixed(2)}`;
    dots += `M${(ex - r).toFixed(2)} ${(-ey).toFixed(2)}a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0`;
    wanted += `M${(x - 0.45).toFixed(2)} ${(-y).toFixed(2)}a.45 .45 0 1 0 .9 0a.45 .45 0 1 0 -.9 0`;
  });
  return html`<svg class="fill" id=${id} viewBox="${x0 - pad} ${-y1 - pad} ${x1 - x0 + 2 * pad} ${y1 - y0 + 2 * pad}" role="img" aria-label=${t("plate")}>
    <rect x=${x0} y=${-y1} width=${x1 - x0} height=${y1 - y0} rx="3" fill="var(--card)" class="axis" />
    <path d=${wanted} class="fw" /><path d=${ticks} class="p" stroke-width="1.2" opacity="0.55" /><path d=${dots} class="fp" />
  </svg>`;
}

// One layer of a part: wanted, and as it is printed.
export function Slice({ wanted, printed, joined, id }) {
  const path = (points) => {
    let text = "";
    points.forEach((p, i) => { if (i && joined[i - 1]) text += (i > 1 && joined[i - 2] ? "L" : `M${points[i - 1][0]} ${-points[i - 1][1]}L`) + `${p[0]} ${-p[1]}`; });
    return text;
  };
  const drawn = wanted.filter((_, i) => joined[i] || joined[i - 1]);
  const xs = drawn.map((p) => p[0]), ys = drawn.map((p) => -p[1]), pad = 9;
  const low = [Math.min(...xs) - pad, Math.min(...ys) - pad], high = [Math.max(...xs) + pad, Math.max(...ys) + pad];
  return html`<svg class="fill" id=${id} viewBox="${low[0]} ${low[1]} ${high[0] - low[0]} ${high[1] - low[1]}" role="img" aria-label=${t("part")}>
    <path d=${path(wanted)} class="w" stroke-width="1.1" opacity="0.8" /><path d=${path(printed)} class="p" stroke-width="1.5" stroke-linejoin="round" />
  </svg>`;
}

// A wall from the side, a bead a layer: where a bent Z screw pushes each.
export function Wall({ wall, id }) {
  const top = wall.at(-1)[0], thin = top / wall.length;
  const bead = (x, z) => html`<rect x=${x - 0.45} y=${-z} width="0.9" height=${thin} rx=${thin / 2} fill="var(--card)" class="p" stroke-width="1.4" />`;
  return html`<svg class="fill" id=${id} viewBox="-5 ${-top - 1.2} 10 ${top + 2}" role="img" aria-label=${t("wall")}>
    <path d="M-5 0H5" class="axis" />${[-2, 2].map((at) => html`<g>${wall.map(([z, push]) => bead(at + push, z))}<rect x=${at - 0.45} y=${-top} width="0.9" height=${top} class="w" stroke-width="1.2" stroke-dasharray="4 3" /></g>`)}</svg>`;
}

const STYLES = ["fill", "stroke", "stroke-width", "stroke-dasharray", "stroke-linejoin", "vector-effect", "opacity", "font-size", "font-weight", "font-family"];

// A drawing as a file that looks like it everywhere: styles written out, pictures put in, on the page's paper.
async function drawn(id) {
  const live = document.getElementById(id), copy = live.cloneNode(true), [x, y, w, h] = live.getAttribute("viewBox").split(" ").map(Number);
  copy.setAttribute("xmlns", "http://www.w3.org/2000/svg");
  copy.removeAttribute("style");
  const nodes = [...live.querySelectorAll("*")], copies = [...copy.querySelectorAll("*")];
  nodes.forEach((node, i) => {
    const style = getComputedStyle(node);
    for (const key of STYLES) copies[i].setAttribute(key, style.getPropertyValue(key));
    copies[i].removeAttribute("style");
  });
  for (const image of copy.querySelectorAll("image")) image.setAttribute("href", await inside(image.getAttribute("href")));
  const paper = document.createElementNS("http://www.w3.org/2000/svg", "rect");
  for (const [key, value] of Object.entries({ x, y, width: w, height: h, fill: getComputedStyle(document.body).backgroundColor })) paper.setAttribute(key, value);
  copy.prepend(paper);
  const scale = 1600 / Math.max(w, h);
  copy.setAttribute("width", w * scale);
  copy.setAttribute("height", h * scale);
  return { text: new XMLSerializer().serializeToString(copy), width: Math.round(w * scale), height: Math.round(h * scale) };
}

async function inside(address) {
  const blob = await (await fetch(address)).blob(), reader = new FileReader();
  return new Promise((done) => { reader.onload = () => done(reader.result); reader.readAsDataURL(blob); });
}

export function saveBlob(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 5000);
}

async function saveDrawing(id, name, kind) {
  const { text, width, height } = await drawn(id);
  if (kind === "svg") return saveBlob(new Blob([text], { type: "image/svg+xml" }), `${name}.svg`);
  const picture = new Image(), canvas = Object.assign(document.createElement("canvas"), { width, height });
  picture.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(text)}`;
  await picture.decode();
  canvas.getContext("2d").drawImage(picture, 0, 0, width, height);
  return canvas.toBlob((blob) => saveBlob(blob, `${name}.png`), "image/png");
}

export const Save = ({ id, name, save = (kind) => saveDrawing(id, name, kind) }) => html`<div class="segment" role="group" aria-label=${t("save")}>${["png", "svg"].map((kind) => html`<button title=${t(`save_${kind}`)} aria-label=${t(`save_${kind}`)} onClick=${() => save(kind)}>${kind.toUpperCase()}</button>`)}</div>`;

export const Number_ = ({ value, unit = "mm", children }) => html`<div class="number"><b>${value} <small>${unit}</small></b><span>${children}</span></div>`;
export const percent = (share) => `${number(100 * share, 0)} %`;

// At most `count` round values from low to high, or one more, each with its label.
export function ticks(low, high, count) {
  const step = nice((high - low) / count), first = Math.ceil(low / step);
  return Array.from({ length: Math.floor(high / step) - first + 1 }, (_, i) => [(first + i) * step, number((first + i) * step, Math.max(0, -Math.floor(Math.log10(step) + 1e-9)))]);
}

// How wide a chart's own units are: on a narrow page fewer, so that its words stay readable.
export const wide = () => (innerWidth < 700 ? Math.max(280, innerWidth - 90) : 900);
