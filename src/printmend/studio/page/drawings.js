// Flat drawings: pulleys, the test print, a layer of a part. All SVG, so that they can be saved and scale.
import { html } from "./vendor.js";
import { number, t } from "./words.js";

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
  const xs = drawn.map((p) => p[0]), ys = drawn.map((p) => -p[1]), pad = 3;
  const low = [Math.min(...xs) - pad, Math.min(...ys) - pad], high = [Math.max(...xs) + pad, Math.max(...ys) + pad];
  return html`<svg class="fill" id=${id} viewBox="${low[0]} ${low[1]} ${high[0] - low[0]} ${high[1] - low[1]}" role="img" aria-label=${t("part")}>
    <path d=${path(wanted)} class="w" stroke-width="1.1" opacity="0.8" /><path d=${path(printed)} class="p" stroke-width="1.5" stroke-linejoin="round" />
  </svg>`;
}

export function saveSvg(id, name) {
  const copy = document.getElementById(id).cloneNode(true);
  copy.setAttribute("xmlns", "http://www.w3.org/2000/svg");
  const live = document.getElementById(id).querySelectorAll("*");
  copy.querySelectorAll("*").forEach((node, i) => {
    const style = getComputedStyle(live[i]);
    for (const key of ["fill", "stroke", "stroke-width", "opacity", "font-size"]) node.setAttribute(key, style.getPropertyValue(key));
  });
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([new XMLSerializer().serializeToString(copy)], { type: "image/svg+xml" }));
  link.download = `${name}.svg`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 5000);
}

export const Number_ = ({ value, unit = "mm", children }) => html`<div class="number"><b>${value} <small>${unit}</small></b><span>${children}</span></div>`;
export const percent = (share) => `${number(100 * share, 0)} %`;

// How wide a chart's own units are: on a narrow page fewer, so that its words stay readable.
export const wide = () => (innerWidth < 700 ? 430 : 900);
