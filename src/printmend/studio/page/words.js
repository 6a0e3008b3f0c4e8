// The words of the page in the reader's language; numbers with the reader's comma.
import en from "./strings.en.js";
import de from "./strings.de.js";

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

export const number = (value, digits = 2) =>
  value === null || value === undefined ? "–" : value.toLocaleString(language, { minimumFractionDigits: digits, maximumFractionDigits: digits });
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
