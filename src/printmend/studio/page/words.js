// The words of the page in the reader's language; numbers with the reader's comma.
import en from "./strings.en.js";
import de from "./strings.de.js";

const LANGUAGES = { en, de };
const kept = (() => { try { return localStorage.getItem("language"); } catch { return null; } })();
export const language = LANGUAGES[kept] ? kept : navigator.language?.startsWith("de") ? "de" : "en";
const place = navigator.languages.find((name) => name.startsWith(language)) ?? language; // a date in India is not one in Texas
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

const NUMBERS = /^(?!.*\d\.\d+\.)[\s\d.±+–−-]*\d\.\d[\s\d.±+–−-]*( ?[%°a-z]+)?$/;
const plainly = (value) => (language === "de" && NUMBERS.test(value) ? value.replaceAll(".", ",") : value);

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

// A message in the reader's language by its id, another text as it is. What is put together has what stands between as its id.
export function said(text) {
  const told = known.get(text);
  if (!told) return text.replaceAll("`", "");
  const part = (value) => (value !== text && known.has(value) ? said(value) : plainly(value)), own = told.texts?.[language === "de" ? 1 : 0];
  const template = catalogue[told.id]?.[language] ?? own;
  if (template) return template.replaceAll("`", "").replace(/\{(\w+)\}/g, (_, name) => part(told.values[name] ?? ""));
  return Object.values(told.values).map(part).join(told.id).replace(/; (The|An?|Der|Die|Das|Ein|Eine|Es|Alle|Jede)\b/g, (found) => found.toLowerCase());
}

// The same, where it stands alone.
export const sentence = (text) => said(text).replace(/^\p{Ll}+ /u, (word) => word[0].toUpperCase() + word.slice(1)).replace(/(?<![.?!…:])$/, ".");

// Why something did not work: what is wrong, then what to do.
export function why(text) {
  const told = known.get(text);
  if (told?.id !== "why") return sentence(text);
  const [subject, wanted, came, todo] = ["a", "b", "c", "d"].map((name) => said(plainly(told.values[name])));
  return t("why", { subject: subject ? `${subject}: ` : "", wanted, came, todo: `${todo[0].toUpperCase()}${todo.slice(1)}${/[.?!]$/.test(todo) ? "" : "."}` });
}

// The least of 1, 2 and 5 times a power of ten that is not below a value, but for a thousandth of it.
export const nice = (value) => { const p = 10 ** Math.floor(Math.log10(value)); return [1, 2, 5, 10].map((k) => k * p).find((v) => v >= value * 0.999); };
export const number = (value, digits = 2) =>
  value === null || value === undefined ? "–" : (Math.abs(value) * 10 ** digits < 0.5 ? 0 : value).toLocaleString(language, { minimumFractionDigits: digits, maximumFractionDigits: digits }).replace("-", "−");
export const bytes = (value) => (value < 1e9 ? `${number(value / 1e6, value < 1e7 ? 1 : 0)} MB` : `${number(value / 1e9, 1)} GB`);
export const digits = (value_mm) => (value_mm < 0.1 ? 3 : 2);
export const mm = (value) => (value === null || value === undefined ? "–" : number(value, digits(value)));
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
export const day = (value) => new Date(value * 1000).toLocaleDateString(place, { day: "numeric", month: "short", year: "numeric" });
export const time = (value) => new Date(value * 1000).toLocaleString(place, { dateStyle: "short", timeStyle: "short" });
