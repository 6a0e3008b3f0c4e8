// My printers: what they are and how they are.
import { html } from "./vendor.js";
import { t } from "./words.js";

export function Printers() {
  return html`<h1>${t("printers")}</h1>`;
}
