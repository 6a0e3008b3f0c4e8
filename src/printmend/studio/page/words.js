// The words of the page in the reader's language; numbers with the reader's comma.
import en from "./strings.en.js";
import de from "./strings.de.js";
import { before, sentences, words } from "./said.de.js";

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

const patterns = sentences.map(([english, german]) => [new RegExp(`^${english.replace(/[.*+?^$()|[\]\\]/g, "\\$&").replace(/\{(\w+)\}/g, "(?<$1>[^;]+?)")}$`), german]);
const comma = (value) => words[value] ?? (/^[-+]?\d+\.\d+$/.test(value) ? value.replace(".", ",") : value);
function german(text) {
  for (const [pattern, into] of patterns) {
    const found = pattern.exec(text);
    if (found) return into.replace(/\{(\w+)\}/g, (_, name) => comma(found.groups[name]));
  }
  return null;
}

// What the program says in English, in the reader's language where somebody has said it there.
export function said(text) {
  const plain = text.replaceAll("`", "");
  for (const [english, into] of before) if (language === "de" && plain.startsWith(english) && plain !== english) { const rest = plain.slice(english.length); return into + said(rest[0].toUpperCase() + rest.slice(1)); }
  const part = (words, at, glue) => german(words) ?? words.split(at).map((one) => (glue === "; " || german(one) ? german(one) ?? one : part(one, "; ", "; "))).join(glue);
  return language === "de" ? part(plain, /(?<=[.:]) (?=[A-Z])/, " ") : plain;
}

export const number = (value, digits = 2) =>
  value === null || value === undefined ? "–" : (Math.abs(value) * 10 ** digits < 0.5 ? 0 : value).toLocaleString(language, { minimumFractionDigits: digits, maximumFractionDigits: digits });
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
export const day = (value) => new Date(value * 1000).toLocaleDateString(language, { day: "numeric", month: "short", year: "numeric" });
