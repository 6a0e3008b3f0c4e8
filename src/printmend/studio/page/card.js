// The card that one sends to a friend: the part before and after, the number, the scale, the printer, the program's name.
// 1200 × 630 units, drawn at twice that.
import { html, useEffect, useState } from "./vendor.js";
import { Dialog } from "./ask.js";
import { ramp } from "./cut.js";
import { saveBlob } from "./drawings.js";
import { gain, times } from "./moment.js";
import { scaleOf, shareOf } from "./scene.js";
import { mm, number, t } from "./words.js";

const W = 1200, H = 630, DOTS = 2, PART = [0, 96, W / 2, 372];

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const loaded = async (blob) => { const picture = new Image(); picture.src = URL.createObjectURL(blob); await picture.decode(); return picture; };

// `before` and `after` are pictures of the part, `numbers` {before_mm, after_mm}, `scene` what the scale is read from.
export async function draw({ before, after, numbers, scene, printer, part }) {
  const canvas = Object.assign(document.createElement("canvas"), { width: W * DOTS, height: H * DOTS }), pen = canvas.getContext("2d"), scale = scaleOf(scene);
  const text = (words, x, y, size, { weight = 400, fill: paint = "--ink", align = "left", most } = {}) => { pen.font = `${weight} ${size}px ${getComputedStyle(document.body).fontFamily}`; pen.fillStyle = colour(paint); pen.textAlign = align; pen.fillText(words, x, y, most); return pen.measureText(words).width; };
  pen.scale(DOTS, DOTS);
  pen.fillStyle = colour("--card");
  pen.fillRect(0, 0, W, H);
  const wide = text(mm(numbers.before_mm), 40, 64, 44, { weight: 680, fill: "--printed" });
  const arrow = 40 + wide + text(" → ", 40 + wide, 64, 40, { fill: "--soft" });
  const end = arrow + text(`${mm(numbers.after_mm)} mm`, arrow, 64, 44, { weight: 680, fill: "--mended" });
  text(t("card_off"), end + 18, 62, 20, { fill: "--soft" });
  const more = gain(numbers.before_mm, numbers.after_mm);
  if (more > 1.5) text(`${times(more)} ${t("better")}`, W - 40, 62, 28, { weight: 640, align: "right" });
  pen.fillStyle = colour("--well");
  pen.fillRect(0, PART[1], W, PART[3]);
  pen.drawImage(before, ...PART);
  pen.drawImage(after, W / 2, ...PART.slice(1));
  pen.fillStyle = colour("--line");
  pen.fillRect(W / 2 - 1, PART[1], 2, PART[3]);
  text(t("printed"), 40, PART[1] + 38, 24, { weight: 620, fill: "--printed" });
  text(t("mended"), W / 2 + 40, PART[1] + 38, 24, { weight: 620, fill: "--mended" });
  for (let i = 0; i < 300; i++) { pen.fillStyle = `rgb(${ramp(scale.fine ? i / 299 : 0.5 + i / 598).join(" ")})`; pen.fillRect(40 + i, 506, 1.5, 16); }
  text("0", 40, 544, 17, { fill: "--soft" });
  text(number(scale.fine || scale.most / 2, 3), 40 + 300 * shareOf(scale.fine || scale.most / 2, scale), 544, 17, { fill: "--soft", align: "center" });
  text(`≥ ${mm(scale.most)}`, 340, 544, 17, { fill: "--soft", align: "right" });
  text(t(scene.doubt ? "colour_expected" : "colour"), 40, 572, 17, { fill: "--soft" });
  text(part, 440, 524, 22, { weight: 620, most: 500 });
  text(printer, 440, 554, 20, { fill: "--soft", most: 700 });
  text("printmend", W - 40, 570, 30, { weight: 700, align: "right", fill: "--accent" });
  text(t("card_says"), W - 40, 596, 18, { fill: "--soft", align: "right" });
  return new Promise((done) => canvas.toBlob(done, "image/png"));
}

// A button that makes the card and shows it. `shots` returns pictures of the part of a size in dots.
export function Share({ shots, numbers, scene, printer, part, name = "printmend" }) {
  const [open, setOpen] = useState(false), [made, setMade] = useState(null);
  useEffect(() => {
    if (!open) return undefined;
    let address;
    (async () => {
      const [before, after] = await Promise.all((await shots(DOTS * PART[2], DOTS * PART[3])).map(loaded)), blob = await draw({ before, after, numbers, scene, printer, part });
      for (const picture of [before, after]) URL.revokeObjectURL(picture.src);
      address = URL.createObjectURL(blob);
      setMade({ blob, address });
    })();
    return () => { URL.revokeObjectURL(address); setMade(null); };
  }, [open]);
  const files = made ? [new File([made.blob], `${name}-card.png`, { type: "image/png" })] : [], sends = made && navigator.canShare?.({ files }); // as phones can
  return html`<button class="primary" onClick=${() => setOpen(true)}>${t("share")}</button>${open && html`<${Dialog} label=${t("share")} closed=${() => setOpen(false)}><div class="stack">
      ${made ? html`<img class="sharecard" src=${made.address} alt=${t("card_alt", { before: mm(numbers.before_mm), after: mm(numbers.after_mm) })} />` : html`<p role="status">${t("drawing")}</p>`}
      <div class="row end"><button onClick=${(event) => event.currentTarget.closest("dialog").close()}>${t("close")}</button>
        ${made && navigator.clipboard?.write && html`<${Copy} blob=${made.blob} />`}<button class=${sends ? "" : "primary"} disabled=${!made} onClick=${() => saveBlob(made.blob, `${name}-card.png`)}>${t("save_card")}</button>
        ${sends && html`<button class="primary" onClick=${() => navigator.share({ files }).catch(() => {})}>${t("send_card")}</button>`}</div></div></${Dialog}>`}`;
}

function Copy({ blob }) {
  const [said, say] = useState("copy");
  return html`<button onClick=${() => navigator.clipboard.write([new ClipboardItem({ "image/png": blob })]).then(() => say("copied"), () => say("copy_not"))}>${t(said)}</button>`;
}
