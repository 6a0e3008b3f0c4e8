// The studio's page: where one is stands in the address after #, so that back and reload work.
import { html, render, useEffect, useState } from "./vendor.js";
import { onAway, STATIC } from "./api.js";
import { Devices } from "./devices.js";
import { Problem } from "./job.js";
import { Play } from "./play.js";
import { Printers } from "./printers.js";
import { Storage } from "./storage.js";
import { language, languages, speak, t } from "./words.js";

const themes = matchMedia("(prefers-color-scheme: dark)");
function theme(next) {
  try { if (next) localStorage.setItem("theme", next); next ??= localStorage.getItem("theme"); } catch { /* a private window */ }
  document.documentElement.dataset.theme = next ?? (themes.matches ? "dark" : "light");
}
theme();
themes.addEventListener("change", () => theme());
if (new URLSearchParams(location.search).has("token")) history.replaceState(null, "", location.pathname + location.hash);

const place = () => location.hash.replace(/^#\/?/, "").split("/").filter(Boolean);

function App() {
  const [at, setAt] = useState(place()), [away, setAway] = useState(false), [, setNarrow] = useState(innerWidth < 700);
  useEffect(() => onAway(setAway), []);
  useEffect(() => {
    const moved = () => { setAt(place()); scrollTo(0, 0); };
    addEventListener("hashchange", moved);
    return () => removeEventListener("hashchange", moved);
  }, []);
  useEffect(() => { // charts have fewer units on a narrow page
    const sized = () => setNarrow(innerWidth < 700);
    addEventListener("resize", sized);
    return () => removeEventListener("resize", sized);
  }, []);
  const here = at[0] ?? "play";
  return html`<header class="top"><a class="brand" href="#/play" aria-label="printmend"><img src="icon.svg" alt="" /><span>printmend</span></a>
      <nav class="nav" aria-label="printmend">${(STATIC ? ["play"] : ["play", "printers"]).map((name) => html`<a href="#/${name}" aria-current=${here === name ? "page" : undefined}>${t(name)}</a>`)}</nav>
      <div class="tools"><button class="quiet" title=${t("language")} aria-label=${t("language")} onClick=${() => speak(languages[(languages.indexOf(language) + 1) % languages.length])}>${language.toUpperCase()}</button>
        <button class="quiet icon" title=${t("theme")} aria-label=${t("theme")} onClick=${() => theme(document.documentElement.dataset.theme === "dark" ? "light" : "dark")}>
          <svg viewBox="0 0 24 24" aria-hidden="true"><circle cx="12" cy="12" r="8" fill="none" stroke="currentColor" stroke-width="2" /><path d="M12 4a8 8 0 0 1 0 16z" fill="currentColor" /></svg></button></div></header>
    <main class="main"><${Problem} error=${away && "gone"} />${here === "printers" ? html`<${Printers} at=${at.slice(1)} />` : here === "storage" ? html`<${Storage} />` : here === "devices" ? html`<${Devices} />` : html`<${Play} />`}</main>`;
}

if (STATIC) navigator.serviceWorker?.register("./sw.js"); // offline after the first visit
render(html`<${App} />`, document.getElementById("app"));
