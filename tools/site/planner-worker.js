// Mends beside the page, which stays alive meanwhile.
import { mended } from "./planner.js";
addEventListener("message", ({ data: [faults, part, known, row] }) => { const { became: _, made: __, ...told } = mended(faults, part, known, row); postMessage(told); });
