// A place to drop files on, which is also a button for the keyboard.
import { html, useRef, useState } from "./vendor.js";
import { t } from "./words.js";

export function Drop({ children, accept, multiple, onFiles, disabled }) {
  const [over, setOver] = useState(false), input = useRef();
  const take = (files) => { const list = [...files]; if (list.length && !disabled) onFiles(multiple ? list : list.slice(0, 1)); };
  return html`<div class="drop ${over ? "over" : ""}" onDragOver=${(event) => { event.preventDefault(); setOver(true); }} onDragLeave=${() => setOver(false)}
      onDrop=${(event) => { event.preventDefault(); setOver(false); take(event.dataTransfer.files); }}>
    ${children}
    <label><input ref=${input} class="hidden-file" type="file" accept=${accept} multiple=${multiple} disabled=${disabled} aria-label=${t("choose")} onChange=${(event) => { take(event.target.files); event.target.value = ""; }} /><span class="button">${t("choose")}</span></label>
  </div>`;
}
