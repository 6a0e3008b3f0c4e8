// Dialogs of our own: one that asks, and one that shows something.
import { html, render, useEffect, useRef } from "./vendor.js";
import { t } from "./words.js";

// A dialog over the page; `closed` hears that it was left by Escape or by a click beside it.
export function Dialog({ label, closed, children }) {
  const place = useRef();
  useEffect(() => { place.current.showModal(); }, []);
  return html`<dialog ref=${place} aria-label=${label} onClose=${closed} onClick=${(event) => event.target === place.current && place.current.close()}>${children}</dialog>`;
}

// Ask something that cannot be undone; resolves to true where the reader says yes.
export function ask(text, yes) {
  return new Promise((answered) => {
    const host = document.body.appendChild(document.createElement("div")), before = document.activeElement;
    let said = false;
    const closed = () => { render(null, host); host.remove(); before?.focus?.(); answered(said); };
    const say = (value) => (event) => { said = value; event.currentTarget.closest("dialog").close(); };
    render(html`<${Dialog} label=${text} closed=${closed}><div class="stack"><p>${text}</p><div class="row end"><button onClick=${say(false)}>${t("keep")}</button><button class="primary" onClick=${say(true)}>${yes}</button></div></div></${Dialog}>`, host);
  });
}
