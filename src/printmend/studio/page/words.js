// The words of the page in the reader's language; numbers with the reader's comma.
import en from "./strings.en.js";
import de from "./strings.de.js";
import { before, sentences, words } from "./said.de.js";
import errors from "./said.errors.js";

const LANGUAGES = { en, de };
const kept = (() => { try { return localStorage.getItem("language"); } catch { return null; } })();
export const language = LANGUAGES[kept] ? kept : navigator.language?.startsWith("de") ? "de" : "en";
document.documentElement.lang = language;

export const languages = Object.keys(LANGUAGES);
export function speak(name) {
  try { localStorage.setItem("language", name); } catch { /* a private window */ }
  location.reload();
}

// t(key, {n: 3}) puts 3 where the text says {n}.
export function t(key, values = {}) {
  const text = LANGUAGES[language][key] ?? en[key] ?? key;
  return text.replace(/\{(\w+)\}/g, (_, name) => values[name] ?? "");
}

const sure = (english) => english.replace(/\{\w+\}/g, "").length; // what says more of itself is looked at first
const patternsOf = (rows) => rows.map(([english, german, ours]) => [new RegExp(`^${english.replace(/[.*+?^$()|[\]\\]/g, "\\$&").replace(/\{(\w+)\}/g, "(?<$1>[^;]+?)")}$`), language === "de" ? german : ours ?? english]);
const once = (make) => { let made; return () => (made ??= make()); }; // not before somebody reads what the program says
const patterns = once(() => patternsOf(sentences)), misfits = once(() => patternsOf([...errors, ...sentences].sort(([a], [b]) => sure(b) - sure(a))));
const plainly = (value) => language !== "de" ? value : words[value] ?? (/^[-+±]?\d+\.\d+( ?[%°a-z]+)?$/.test(value) ? value.replace(".", ",") : value);
function ours(text, all) {
  for (const [pattern, into] of all) {
    const found = pattern.exec(text);
    // a part may be a sentence itself, as what a scan's scale is known from
    if (found) return into.replace(/\{(\w+)\}/g, (_, name) => { const part = found.groups[name], whole = byId(part) ?? plainly(part); return whole === part && part !== text ? ours(part, patterns().filter(([one]) => one !== pattern)) ?? part : whole; });
  }
  return null;
}

// Every message that has an id: what the page says in each language. What is said comes in English, with ids beside it.
const catalogue = await fetch("messages.json").then((answer) => answer.json()).catch(() => ({}));
const known = new Map();

// Take note of the messages in an answer of the studio; returns the answer.
export function heed(value) {
  if (Array.isArray(value)) { if (typeof value[0] === "object") value.forEach(heed); } else if (value && typeof value === "object") {
    for (const [english, told] of Object.entries(value.messages ?? {})) known.set(english, told);
    for (const [name, one] of Object.entries(value)) if (name !== "messages") heed(one);
  }
  return value;
}

// A message in the reader's language by its id; null for another text. What is put together has what stands between as its id.
function byId(text) {
  const told = known.get(text);
  if (!told) return null;
  const part = (value) => (value === text ? null : byId(value)) ?? plainly(value), entry = catalogue[told.id];
  if (!entry) return Object.values(told.values).map(part).join(told.id);
  return entry[language].replaceAll("`", "").replace(/\{(\w+)\}/g, (_, name) => part(told.values[name] ?? ""));
}

// What the program says in English, in the page's words: in the reader's language where somebody has said it there.
export function said(text) {
  const whole = byId(text);
  if (whole !== null) return whole;
  const plain = text.replaceAll("`", "");
  for (const [english, into] of before) if (language === "de" && plain.startsWith(english) && plain !== english) { const rest = plain.slice(english.length); return into + said(rest[0].toUpperCase() + rest.slice(1)); }
  const clause = (one) => { const whole = byId(one) ?? ours(one, patterns()); if (whole !== null || !one.endsWith(".")) return whole; const bare = ours(one.slice(0, -1), patterns()); return bare === null ? null : `${bare}.`; };
  const clauses = (one) => clause(one) ?? one.split("; ").map((each) => clause(each) ?? each).map((each, i) => i && language === "de" ? each.replace(/^(Der|Die|Das|Ein|Eine|Es|Was|Nach|Je|Im|In|Auf|Längs) /, (word) => word.toLowerCase()) : each).join("; ");
  return ours(plain, patterns()) ?? plain.split(/(?<=[.:]) (?=[A-Z])/).map(clauses).join(" ");
}

// The same, where it stands alone.
export const sentence = (text) => said(text).replace(/^\p{Ll}+ /u, (word) => word[0].toUpperCase() + word.slice(1));

// Why something did not work: what was wanted, what came, what to do.
export function why(text) {
  const plain = text.replaceAll("`", ""), told = known.get(text), found = told?.id === "why" ? ["a", "b", "c", "d"].map((name) => told.values[name]) : /^(?:(.*?): )?wanted (.*?), got (.*?); (.+)$/s.exec(plain)?.slice(1);
  if (!found) return byId(text) ?? ours(plain, misfits()) ?? plain;
  const [subject, wanted, came, todo] = found.map((part) => part && (byId(part) ?? ours(part.replaceAll("`", ""), misfits()) ?? plainly(part)));
  return t("why", { subject: subject ? `${subject}: ` : "", wanted, came, todo: `${todo[0].toUpperCase()}${todo.slice(1)}${/[.?!]$/.test(todo) ? "" : "."}` });
}

export const number = (value, digits = 2) =>
  value === null || value === undefined ? "–" : (Math.abs(value) * 10 ** digits < 0.5 ? 0 : value).toLocaleString(language, { minimumFractionDigits: digits, maximumFractionDigits: digits });
export const bytes = (value) => (value < 1e9 ? `${number(value / 1e6, value < 1e7 ? 1 : 0)} MB` : `${number(value / 1e9, 1)} GB`);
export const mm = (value) => (value === null || value === undefined ? "–" : number(value, value < 0.1 ? 3 : 2));
// What somebody typed, with a comma or a point; NaN where it is no number.
export const typed = (text) => (text.trim() === "" ? NaN : Number(text.trim().replace(",", ".")));
// What was asked for, null where nothing was typed; an error that says what was typed where it is no number.
export function asked(text) {
  if (text.trim() === "") return null;
  if (!Number.isFinite(typed(text))) throw new Error(t("no_number", { text }));
  return typed(text);
}
export function seconds(value) {
  if (value === null || value === undefined) return "";
  return value < 90 ? t("left_s", { n: Math.max(1, Math.round(value)) }) : t("left_min", { n: Math.round(value / 60) });
}
// How long a print takes.
export function lasting(seconds) {
  const minutes = Math.max(1, Math.round(seconds / 60)), hours = Math.floor(minutes / 60);
  return hours ? t("hours", { h: hours, m: minutes % 60 }) : t("minutes", { m: minutes });
}
export const day = (value) => new Date(value * 1000).toLocaleDateString(language, { day: "numeric", month: "short", year: "numeric" });
