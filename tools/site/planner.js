// Mend it, without a server: the program's planner, translated (kernels/), over the part's moves, for the printer exactly as
// the sliders break it. Then the broken printer prints both files, as `printmend.studio.scene` has it.
import { branch, machine } from "./faults.js";
import { distances, from_motors, off_bed, onto_bed, to_motors } from "./law.js";
import { CURVE } from "./kernels/plan-kernels-curve.js";
import { BEND_BLOCK, HEAD, set_chords } from "./kernels/plan-kernels-lookup.js";
import { COUNTS, LAYER, PIECES_A_RECORD, RUN, STATE, TOLERANCE_MM } from "./kernels/plan-kernels-layout.js";
import { mend } from "./kernels/plan-kernels-mend.js";
import { PIECE } from "./kernels/gcode-kernels-layout.js";

const QUANTUM_MM = 0.001, SEGMENTS_PER_S = 1000, AT_ONCE = 4096, BEND_REACH_MM = 0.05, RISE_LOOK_MM = 0.05, BESIDE = 1e-7, PITCH_MM = 0.8, UNIT_MM = 0.002, TURN = 2 * Math.PI;
const rounded = (v) => Math.round(v * 1e9) / 1e9;
const clamp = (v, low, high) => Math.min(Math.max(v, low), high);

// A branch as the model file keeps it: errors to 1e-9 mm, never falling.
function saved(table, first, pitch) {
  const out = Float64Array.from(table, (u, i) => first + pitch * i + rounded(u - (first + pitch * i)));
  for (let i = 1; i < out.length; i++) out[i] = Math.max(out[i], out[i - 1]);
  return out;
}

function bends(tables, pitch) {
  const reach = Math.max(1, Math.round(BEND_REACH_MM / pitch)), size = tables[0].length, most = new Array(Math.ceil(size / BEND_BLOCK)).fill(0);
  for (const table of tables) for (let i = reach; i < size - reach; i++) {
    const bend = Math.abs(table[i + reach] - 2 * table[i] + table[i - reach]) / (reach * pitch) ** 2, block = Math.floor(i / BEND_BLOCK);
    if (bend >= 1e-6 && bend > most[block]) most[block] = bend;
  }
  return most.map((v, i) => Math.max(v, most[i - 1] ?? 0, most[i + 1] ?? 0));
}

// The machine as the kernels read it (`printmend.plan.inverse.lookup`).
function lookup({ way, drives, screw }, known) {
  const head = HEAD(), tables = [];
  head.bed = [known.bed_mm[0], known.bed_mm[2], known.bed_mm[1], known.bed_mm[3]];
  head.bed_map = way; head.home = known.home_mm; head.home_side = known.home_sides;
  let sharpest = 0;
  [...drives, ...(screw ? [screw] : [])].forEach((drive, motor) => {
    const pitch = 1 / drive.rate, branches = [drive.lower, drive.upper], bend = bends(branches, pitch);
    if (motor < 2) { sharpest = Math.max(sharpest, ...bend); head.bent = Math.max(head.bent, bend.reduce((sum, v) => sum + v, 0) / bend.length); }
    head.first[motor] = drive.first; head.rate[motor] = drive.rate; head.last[motor] = drive.lower.length - 1;
    head.bend[motor] = tables.length; head.bend_last[motor] = bend.length - 1; head.taut[motor] = Number(drive.lower.every((u, i) => u === drive.upper[i]));
    for (const v of bend) tables.push(v);
    branches.forEach((table, k) => {
      const size = table.length, steps = Math.trunc((table[size - 1] - table[0]) / pitch) + 2;
      head.table[motor][k] = tables.length; head.floor[motor][k] = table[0]; head.guide[motor][k] = tables.length + size;
      for (const v of table) tables.push(v);
      for (let n = 0, at = 0; n < steps; n++) { while (at < size - 1 && table[at] < table[0] + n * pitch) at++; tables.push(at); }
    });
  });
  head.chord = TOLERANCE_MM / 2; set_chords({ head }, TOLERANCE_MM, 0);
  head.sample = clamp(Math.sqrt((2 * head.chord) / Math.max(sharpest, 1e-12)), 0.02, 2); head.look = 2;
  head.frame_bend = frameBend(way, known.bed_mm); head.period = 1 / (60 * SEGMENTS_PER_S);
  if (screw) {
    head.screw = 1; head.rise = rise(screw, head.chord); head.z_limits = known.screw.limits_mm; head.z_home = known.screw.home_mm; head.z_home_side = known.screw.home_side;
    head.push = screw.pushes.map((push, i) => tables.length + i * push.length);
    for (const push of screw.pushes) for (const v of push) tables.push(v);
  }
  return { head, tables };
}

function frameBend(way, [x0, y0, x1, y1]) {
  let most = 0;
  for (let i = 0; i < 23; i++) for (let j = 0; j < 23; j++) for (const [dx, dy] of [[5, 0], [0, 5], [3.5, 3.5], [3.5, -3.5]]) {
    const [a, b, c] = [-1, 0, 1].map((s) => onto_bed(way, x0 + ((x1 - x0) * i) / 22 + s * dx, y0 + ((y1 - y0) * j) / 22 + s * dy));
    most = Math.max(most, Math.hypot(a[0] - 2 * b[0] + c[0], a[1] - 2 * b[1] + c[1]) / (dx * dx + dy * dy));
  }
  return most;
}

// Where the screw pushes the nozzle along each axis; beyond its tables that stays.
const pushAt = ({ pushes, first, rate }, m) => pushes.map((push) => branch({ push, first, rate }, "push", clamp(m, first, first + (push.length - 1) / rate)));
function rise(screw, chord) { // its height is as commanded: only the push bends
  let most = 0;
  const low = screw.first, high = low + (screw.lower.length - 1) / screw.rate, at = Array.from({ length: Math.ceil((high - low) / RISE_LOOK_MM) }, (_, i) => pushAt(screw, low + i * RISE_LOOK_MM));
  for (let i = 1; i < at.length - 1; i++) most = Math.max(most, Math.hypot(...[0, 1].map((k) => at[i + 1][k] - 2 * at[i][k] + at[i - 1][k])) / RISE_LOOK_MM ** 2);
  return clamp(Math.sqrt((4 * chord) / Math.max(most, 1e-12)), RISE_LOOK_MM, 1e3);
}

// The broken printer as its model would be if every number of it were known.
export function exact(faults, known) {
  const { way, drives } = machine(faults, known), { first_mm: first, pitch_mm: pitch, count, mm_per_turn: lead, phase_rad: phase, home_mm: home } = known.screw;
  const kept = drives.map((drive) => ({ ...drive, lower: saved(drive.lower, drive.first, 1 / drive.rate), upper: saved(drive.upper, drive.first, 1 / drive.rate) }));
  way.terms = way.terms.map((row) => row.map(rounded));
  if (!faults.screw_mm) return { way, drives: kept, screw: null };
  const grid = Float64Array.from({ length: count }, (_, i) => first + pitch * i), screw = { first, rate: 1 / pitch, lower: grid, upper: grid };
  screw.pushes = [Math.cos, Math.sin].map((wave) => grid.map((m) => faults.screw_mm * wave(m * (TURN / lead) + phase)));
  const at = pushAt(screw, home);
  return { way, drives: kept, screw: { ...screw, pushes: screw.pushes.map((push, k) => push.map((v) => rounded(v - at[k]))) } };
}

// Plan all records: how many pieces each became, and the pieces.
export function planned(broken, part, known) {
  const model = lookup(broken, known), names = part.columns, rows = part.rows[0].map((_, i) => Object.fromEntries(names.map((name, k) => [name, part.rows[k][i]])));
  const state = STATE(), counts = COUNTS(), first = new Array(rows.length + 1).fill(0), pieces = Array.from({ length: PIECES_A_RECORD + AT_ONCE }, PIECE), made = [], became = [];
  state.layer_z = Infinity; counts.layer = counts.mark = -1;
  const scratch = [CURVE(), broken.screw ? CURVE() : null], layers = [LAYER()], run = RUN();
  for (let begin = 0; begin < rows.length;) {
    const end = mend(model, rows, begin, rows.length, state, counts, scratch[0], scratch[1], first, pieces, layers, null, QUANTUM_MM, null, run);
    for (let i = begin; i < end; i++) { became.push(first[i + 1] - first[i]); for (let n = first[i]; n < first[i + 1]; n++) made.push({ ...pieces[n] }); }
    begin = end;
  }
  return { rows, became, made };
}

const length3 = (a, b) => Math.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 + (b[2] - a[2]) ** 2);
const apart = (a, b) => a[0] !== b[0] || a[1] !== b[1] || a[2] !== b[2];

// Points along lines {start, end, begin, finish}, and which part of the file each is.
function points(lines) {
  const out = [], at = [];
  lines.forEach((line, i) => {
    const count = Math.max(Math.ceil(length3(line.start, line.end) / PITCH_MM), 1), jumped = i === 0 || apart(line.start, lines[i - 1].end);
    for (let step = jumped ? 0 : 1; step <= count; step++) {
      const share = step / count;
      out.push([0, 1, 2].map((axis) => line.start[axis] + share * (line.end[axis] - line.start[axis])));
      at.push(line.begin + share * (line.finish - line.begin));
    }
  });
  return [out, at];
}

// What the head is told to do instead (`scene._given_lines`).
function given(lines, became, made) {
  const out = [];
  let piece = 0;
  lines.forEach((line, i) => {
    const jumped = i === 0 || apart(line.start, lines[i - 1].end), last = out.at(-1)?.end, start = jumped ? line.start : last;
    if (!became[i]) {
      const still = line.start[0] === line.end[0] && line.start[1] === line.end[1] && !jumped;
      out.push({ start, end: still ? [last[0], last[1], line.end[2]] : line.end, begin: i, finish: i + 1 });
      return;
    }
    for (let n = 0, done = 0, from = start; n < became[i]; n++) {
      const p = made[piece++], end = [p.x, p.y, p.z], before = done;
      done = n === became[i] - 1 ? 1 : Math.min(done + p.share, 1);
      out.push({ start: from, end, begin: i + before, finish: i + done });
      from = end;
    }
  });
  return out;
}

// Where the machine prints commanded places, one after the other from home (`print_from_home`), seen from above.
function print({ way, drives, screw }, places, { home_mm: home }) {
  const belts = to_motors(way, ...off_bed(way, ...home));
  const follow = ([x, y]) => to_motors(way, x, y).forEach((m, k) => { belts[k] = Math.min(Math.max(belts[k], branch(drives[k], "lower", m)), branch(drives[k], "upper", m)); });
  follow(home);
  return places.map((place) => {
    follow(place);
    const [x, y] = onto_bed(way, ...from_motors(way, belts[0], belts[1]));
    if (!screw) return [x, y];
    const [px, py] = pushAt(screw, place[2]);
    return [x + px, y + py];
  });
}

function interpolated(look, xp, fp) {
  return look.map((x) => {
    if (x <= xp[0]) return fp[0];
    if (x >= xp.at(-1)) return fp.at(-1);
    let low = 0, high = xp.length - 1;
    while (high - low > 1) { const middle = (low + high) >> 1; if (xp[middle] <= x) low = middle; else high = middle; }
    const share = (x - xp[low]) / (xp[high] - xp[low]);
    return [0, 1].map((axis) => fp[low][axis] + share * (fp[high][axis] - fp[low][axis]));
  });
}

// The part's points, as `scene.lay_points` has them.
function laid(lines, part) {
  const [places, at] = points(lines), { drawn, layer } = part, n = places.length, last = lines.length - 1;
  const record = at.map((v) => clamp(Math.ceil(v) - 1, 0, last)), ends = at.map((v, i) => Boolean(drawn[record[i]]) && v > record[i]);
  const leads = at.map((v, i) => i + 1 < n && ends[i + 1] && at[i + 1] - v <= 1), keep = places.map((_, i) => i).filter((i) => ends[i] || leads[i]);
  const of = keep.map((i) => layer[ends[i] ? record[i] : Math.min(record[i] + 1, last)]), joined = keep.map((i, j) => leads[i] && j + 1 < keep.length && of[j + 1] === of[j]);
  return { places, at, ends, keep, joined, wanted: keep.map((i) => places[i]) };
}

// How far printed points lie from the drawn ones, the whole part at its best place; and from the wanted path.
function off({ keep, joined, wanted }, printed, near) {
  const by = keep.map((i, j) => [printed[i][0] - wanted[j][0], printed[i][1] - wanted[j][1]]);
  let a = 0, b = 0, c = 0, p = 0, q = 0;
  joined.forEach((leads, j) => {
    if (!leads) return;
    const wx = wanted[j + 1][0] - wanted[j][0], wy = wanted[j + 1][1] - wanted[j][1], length = Math.hypot(wx, wy);
    if (!length) return;
    const tx = wx / length, ty = wy / length, mx = (by[j][0] + by[j + 1][0]) / 2, my = (by[j][1] + by[j + 1][1]) / 2, left = tx * my - ty * mx;
    a += length * ty * ty; b -= length * ty * tx; c += length * tx * tx; p -= length * ty * left; q += length * tx * left;
  });
  const area = a * c - b * b, shift = area ? [(c * p - b * q) / area, (a * q - b * p) / area] : [0, 0], moved = by.map(([x, y]) => [x - shift[0], y - shift[1]]), error = new Float64Array(wanted.length);
  distances(wanted, moved.map(([x, y], j) => [wanted[j][0] + x, wanted[j][1] + y]), joined, near, error);
  return { moved, error };
}

function figures({ wanted, joined }, error) {
  let sum = 0, weight = 0;
  joined.forEach((leads, j) => { if (!leads) return; const length = length3(wanted[j], wanted[j + 1]); sum += (length * (error[j] ** 2 + error[j + 1] ** 2)) / 2; weight += length; });
  const sorted = Float64Array.from(error).sort(), at = 0.95 * (sorted.length - 1), low = Math.floor(at);
  return { rms_mm: Math.sqrt(sum / weight), p95_mm: sorted[low] + (at - low) * ((sorted[low + 1] ?? sorted[low]) - sorted[low]) };
}

function packed({ moved, error }, row) {
  const table = new Int16Array(Math.ceil(error.length / row) * row * 4);
  error.forEach((e, i) => { for (const axis of [0, 1]) table[4 * i + axis] = clamp(Math.round(moved[i][axis] / UNIT_MM), -32767, 32767); table[4 * i + 2] = clamp(Math.round(e * 1000), 0, 32767); });
  return table;
}

// Mend the part for these faults: its figures before and after, and its picture in tables as the page reads them.
export function mended(faults, part, known, row) {
  const broken = exact(faults, known), { rows, became, made } = planned(broken, part, known), moves = rows.map((r, i) => i).filter((i) => rows[i].kind === 1);
  const lines = moves.map((i, n) => ({ start: [rows[i].x0, rows[i].y0, rows[i].z0], end: [rows[i].x1, rows[i].y1, rows[i].z1], begin: n, finish: n + 1 }));
  const drawing = laid(lines, part), raw = off(drawing, print(broken, drawing.places, known), known.near);
  const [places, at] = points(given(lines, moves.map((i) => became[i]), made)), look = drawing.at.map((v, i) => v + (drawing.ends[i] ? -BESIDE : BESIDE));
  const after = off(drawing, interpolated(look, at, print(broken, places, known)), known.near);
  return { before: figures(drawing, raw.error), after: figures(drawing, after.error), raw: packed(raw, row), mended: packed(after, row), became, made };
}
