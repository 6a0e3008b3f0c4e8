// What the browser's tab says: where one is, and the program's name.
import { useEffect } from "./vendor.js";

export const useTitle = (...places) => useEffect(() => { document.title = [...places.filter(Boolean), "printmend"].join(" – "); }, places);
