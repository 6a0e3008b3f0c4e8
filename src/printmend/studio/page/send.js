// Send a file to the program that the printer prints with: OctoPrint, or Moonraker behind Mainsail and Fluidd.
import { html, useEffect, useState } from "./vendor.js";
import { ended, get, post, remove } from "./api.js";
import { ask, Dialog } from "./ask.js";
import { Problem, Progress, useJob, useProblem } from "./job.js";
import { t } from "./words.js";

const NAMES = { octoprint: "OctoPrint", moonraker: "Moonraker" };

// `file` says what: {} is the test print, {job, name} a file that a job made.
// A code by which Moonraker or OctoPrint gets this printer's model, and each newer one.
export function Pair({ printer }) {
  const [made, setMade] = useState(null), [hosts, setHosts] = useState([]), [error, tried] = useProblem();
  const load = () => get(`/printers/${printer.id}/pairs`).then(setHosts, () => {});
  useEffect(() => { load(); }, [printer.id]);
  const make = () => tried(async () => setMade(await post(`/printers/${printer.id}/pair`)));
  const part = async ({ name }) => { if (await ask(t("part_sure", { name }), t("unpair"))) await tried(async () => { await remove(`/printers/${printer.id}/pairs/${encodeURIComponent(name)}`); load(); }); };
  const line = made && `printmend pair ${made.address} ${made.code} -m printer.mend.json`;
  return html`<section class="card stack"><h2>${t("pair")}</h2><p class="soft">${t("pair_now")}</p><${Problem} error=${error} />
    ${hosts.map((one) => html`<div class="row between"><b>${one.name}</b><button class="quiet" onClick=${() => part(one)}>${t("unpair")}</button></div>`)}
    <div><button onClick=${make}>${t("pair_make")}</button></div>
    ${made && html`<${Dialog} label=${t("pair")} closed=${() => { setMade(null); load(); }}><div class="stack"><p>${t("pair_how", { n: made.minutes })}</p><p class="code">${made.code.slice(0, 3)} ${made.code.slice(3)}</p><code class="address">${made.address}</code><code class="address">${line}</code>${["localhost", "127.0.0.1", "[::1]"].includes(new URL(made.address).hostname) && html`<p class="faint">${t("pair_here")}</p>`}<div class="row end"><button onClick=${(event) => event.currentTarget.closest("dialog").close()}>${t("close")}</button></div></div></${Dialog}>`}</section>`;
}

export function Send({ printer, changed, file = {} }) {
  const [key, setKey] = useState(null), [error, setError] = useState(null), [open, setOpen] = useState(false), job = useJob(key), { host } = printer;
  useEffect(() => { setKey(null); setError(null); }, [file.job, file.name]);
  useEffect(() => { if (job?.state === "failed") setError(job.error); }, [job?.state]);
  const send = async () => { setError(null); try { setKey((await post(`/printers/${printer.id}/send`, file)).id); } catch (problem) { setError(problem.message); } };
  const busy = key && !ended(job);
  return html`<div class="stack" data-testid="send"><div class="row">
      ${host && html`<button disabled=${busy} onClick=${send}>${t("send_to", { host: NAMES[host.kind] })}</button>`}
      <button class="quiet" aria-expanded=${open} onClick=${() => setOpen(!open)}>${t(host ? "send_change" : "send_setup")}</button></div>
    <${Problem} error=${error} /><${Progress} job=${busy ? job ?? { id: key, state: "queued", share: 0 } : null} />
    ${job?.state === "done" && html`<p class="note" role="status">${t("sent", { name: job.result.name, host: job.result.host })} <a href=${job.result.address} target="_blank" rel="noreferrer noopener">${job.result.address}</a></p>`}
    ${open && html`<${Connect} printer=${printer} done=${() => { setOpen(false); changed(); }} />`}</div>`;
}

function Connect({ printer, done }) {
  const [address, setAddress] = useState(printer.host?.address ?? ""), [key, setKey] = useState(""), [error, tried] = useProblem(), [busy, setBusy] = useState(false);
  const go = async (event) => {
    event.preventDefault();
    setBusy(true);
    await tried(async () => { await post(`/printers/${printer.id}/host`, { address, key }); done(); });
    setBusy(false);
  };
  const forget = () => tried(async () => { await remove(`/printers/${printer.id}/host`); done(); });
  return html`<form class="card stack" onSubmit=${go}><p class="soft">${t("send_now")}</p>
    <label class="field">${t("address")}<input value=${address} required maxlength="300" spellcheck="false" autocapitalize="off" placeholder="octopi.local" onInput=${(event) => setAddress(event.target.value)} /></label>
    <label class="field">${t("api_key")}<input value=${key} type="password" maxlength="300" autocomplete="off" onInput=${(event) => setKey(event.target.value)} /></label>
    <${Problem} error=${error} /><div class="row"><button class="primary" disabled=${busy || !address.trim()}>${t(busy ? "connecting" : "connect")}</button>
    ${printer.host && html`<button type="button" class="quiet" onClick=${forget}>${t("disconnect")}</button>`}</div></form>`;
}
