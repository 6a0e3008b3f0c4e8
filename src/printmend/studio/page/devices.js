// Devices: who may enter from other computers; a new one comes in by a QR code.
import { html, useEffect, useState } from "./vendor.js";
import { get, post, remove } from "./api.js";
import { ask, Dialog } from "./ask.js";
import { Problem, useProblem } from "./job.js";
import { useTitle } from "./title.js";
import { day, t } from "./words.js";

export function Devices() {
  const [known, setKnown] = useState(null), [error, tried, setError] = useProblem(), [name, setName] = useState(""), [user, setUser] = useState(""), [fresh, setFresh] = useState(null);
  useTitle(t("devices"));
  const [local, setLocal] = useState(false), load = () => get("/devices").then(setKnown, (problem) => setError(problem.message));
  useEffect(() => { get("/health").then(({ shared }) => (shared ? load() : setLocal(true)), (problem) => setError(problem.message)); }, []);
  const add = (event) => { event.preventDefault(); tried(async () => { setFresh(await post("/devices", { name, user })); setName(""); load(); }); };
  const away = async (one) => {
    if (!(await ask(t("revoke_sure", { name: one.name }), t("revoke")))) return;
    await tried(async () => { await remove(`/devices/${encodeURIComponent(one.name)}`); load(); });
  };
  return html`<div class="head"><div><h1>${t("devices")}</h1><p class="now">${t(local ? "devices_local" : "devices_now")}</p></div></div><${Problem} error=${error} />
    ${known && html`<div class="split"><form class="card stack" onSubmit=${add}><h2>${t("device_new")}</h2><label class="field">${t("device_name")}<input value=${name} required maxlength="60" onInput=${(event) => setName(event.target.value)} /></label>
        <label class="field">${t("device_user")}<input value=${user} maxlength="60" onInput=${(event) => setUser(event.target.value)} /></label><button class="primary" disabled=${!name.trim()}>${t("device_add")}</button></form>
      <section class="card stack">${known.map((one) => html`<div class="stored"><div><h2>${one.name}</h2><p class="faint">${one.user ? t("device_of", { user: one.user }) : t("device_all")}, ${day(one.created_s)}</p></div><span></span><button onClick=${() => away(one)}>${t("revoke")}</button></div>`)}</section></div>`}
    ${fresh && html`<${Dialog} label=${fresh.name} closed=${() => setFresh(null)}><div class="stack"><h2>${fresh.name}</h2><p>${t("device_scan")}</p><img class="qr" src=${fresh.qr} alt=${t("device_qr")} /><p class="faint address">${fresh.address}</p><div class="row end"><button onClick=${(event) => event.currentTarget.closest("dialog").close()}>${t("close")}</button></div></div></${Dialog}>`}`;
}
