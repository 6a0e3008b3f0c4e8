// What the sliders break, as tables of a machine, and what it prints: the preview of the play screen without a server.
// law.js is translated from the program's kernels; printer.json holds the printer, its test print and its part.
import { branch_at, clip, distances, from_motors, onto_bed, push_at, to_motors, off_bed } from "./law.js";

const TURN = 2 * Math.PI, SAMPLES = 16384, ANGLES = 180;

// The support function of a pulley (physics.md, eq. 1): how far the belt's line is from the shaft at angle phi.
function support({ shape, dent_mm: dent, angle_deg: angle }, radius, mostDent) {
  const phase = (angle * Math.PI) / 180;
  if (shape === "round" || dent <= 0) return null;
  if (shape === "eccentric") return (phi) => radius + dent * Math.cos(phi - phase);
  if (shape === "oval") return (phi) => Math.hypot((radius + dent) * Math.cos(phi - phase), (radius - dent) * Math.sin(phi - phase));
  if (shape === "flat") {
    const beta = Math.acos(Math.max(-1, (radius - dent) / radius));
    return (phi) => { const away = Math.abs(Math.atan2(Math.sin(phi - phase), Math.cos(phi - phase))); return away < beta ? radius * Math.cos(beta - away) : radius; };
  }
  const corner = (radius * Math.PI) / (4 * Math.sin(Math.PI / 4)), radii = [0, 1, 2, 3].map((i) => Number((corner * (1 + 0.12 * (dent / mostDent) * (-1) ** i)).toFixed(4)));
  return (phi) => Math.max(...radii.map((r, i) => r * Math.cos(phi - (phase + (2 * Math.PI * i) / 4))));
}

// The transmission of a motor: its two branches over the motor's position, as the program tabulates them.
function transmission(side, axis, mostDent) {
  const h = support(side, axis.radius_mm, mostDent), at = Float64Array.from({ length: axis.count }, (_, i) => axis.first_mm + axis.pitch_mm * i);
  let span = at;
  if (h) {
    const t = Float64Array.from({ length: SAMPLES + 1 }, (_, i) => (i === SAMPLES ? TURN : i * (TURN / SAMPLES))), turn = new Float64Array(SAMPLES + 1);
    let before = h(-t[0]);
    for (let i = 1; i <= SAMPLES; i++) { const now = h(-t[i]); turn[i] = turn[i - 1] + ((now + before) / 2) * (t[1] - t[0]); before = now; }
    span = at.map((m) => {
      const angle = m * (TURN / axis.mm_per_turn), turns = Math.floor(angle / TURN), rest = Math.min(Math.max(angle - turns * TURN, 0), TURN), i = Math.min(SAMPLES - 1, Math.floor(rest / t[1]));
      return turns * turn[SAMPLES] + turn[i] + ((turn[i + 1] - turn[i]) / (t[i + 1] - t[i])) * (rest - t[i]);
    });
  }
  const half = side.play_mm > 0 ? side.play_mm / 2 : 0;
  return { first: axis.first_mm, rate: 1 / axis.pitch_mm, lower: half ? span.map((u) => u - half) : span, upper: half ? span.map((u) => u + half) : span };
}

export const branch = (drive, name, m) => branch_at(drive[name], 0, drive.first, drive.rate, drive[name].length - 1, m);

// A machine that has just been homed: the engaged branches pass through the end stops.
export function machine(faults, { axes, home_mm: home, corexy, most_dent_mm: mostDent }) {
  const terms = [new Float64Array(10), new Float64Array(10)];
  terms[0][2] = Math.tan((faults.skew_deg * Math.PI) / 180) * 100;
  const way = { corexy: corexy ? 1 : 0, framed: faults.skew_deg ? 1 : 0, origin: [0, 0], scale: [100, 100], terms, wave_count: 0, waves: [] };
  const wanted = to_motors(way, ...off_bed(way, ...home)), at = to_motors(way, ...home);
  const drives = [faults.x, faults.y].map((side, k) => {
    const drive = transmission(side, axes[k], mostDent), by = wanted[k] - branch(drive, axes[k].home_way > 0 ? "lower" : "upper", at[k]);
    return { ...drive, lower: drive.lower.map((v) => v + by), upper: drive.upper.map((v) => v + by) };
  });
  return { way, drives, at };
}

const rint = (v) => { const low = Math.floor(v), off = v - low; return off < 0.5 ? low : off > 0.5 ? low + 1 : low % 2 === 0 ? low : low + 1; };

// Where a machine prints straight moves between places, the first being home (Twin.follow).
function follow({ way, drives, at }, places, axes) {
  const belts = drives.map((drive, k) => branch(drive, axes[k].home_way > 0 ? "lower" : "upper", at[k]));
  return places.map(([x, y]) => {
    to_motors(way, x, y).forEach((m, k) => {
      const on = axes[k].first_mm + rint((m - axes[k].first_mm) / axes[k].pitch_mm) * axes[k].pitch_mm;
      belts[k] = clip(belts[k], branch(drives[k], "lower", on), branch(drives[k], "upper", on));
    });
    return onto_bed(way, ...from_motors(way, belts[0], belts[1]));
  });
}

const mean = (rows) => [0, 1].map((axis) => rows.reduce((sum, row) => sum + row[axis], 0) / rows.length);

function outline(side, radius, mostDent) {
  const h = support(side, radius, mostDent), psi = Array.from({ length: ANGLES }, (_, i) => i * (TURN / ANGLES)), supports = psi.map((a) => (h ? h(a) : radius));
  return psi.map((b) => {
    const reach = Math.min(...psi.map((a, i) => { const facing = Math.cos(b - a); return facing > 1e-3 ? supports[i] / facing : Infinity; }));
    return [reach * Math.cos(b), reach * Math.sin(b)];
  });
}

function wall(screwMm, { first_mm: first, pitch_mm: pitch, count, mm_per_turn: lead, phase_rad: phase, heights_mm: heights }) {
  const entries = new Proxy({}, { get: (_, i) => screwMm * Math.cos((first + pitch * Number(i)) * (TURN / lead) + phase) });
  const push = heights.map((z) => (screwMm ? push_at(entries, 0, first, 1 / pitch, count - 1, z) : 0)), middle = push.reduce((sum, v) => sum + v, 0) / push.length;
  return heights.map((z, i) => [z, push[i] - middle]);
}

// As `printmend.studio.play.shown`, number for number.
export function preview(faults, known) {
  const { axes, part } = known, broken = machine(faults, known), marks = follow(broken, known.waypoints_mm, axes), off = known.rows.map((row, i) => [0, 1].map((axis) => marks[row][axis] - known.marks_mm[i][axis]));
  const drawn = follow(broken, [known.home_mm, ...part.places_mm], axes).slice(1), by = mean(drawn.map((p, i) => [p[0] - part.places_mm[i][0], p[1] - part.places_mm[i][1]]));
  const printed = drawn.map(([x, y]) => [x - by[0], y - by[1]]), middle = mean(off), error = new Float64Array(printed.length);
  distances(part.places_mm, printed, part.joined, known.near, error);
  let sum = 0, weight = 0;
  part.places_mm.slice(1).forEach((p, i) => { const length = part.joined[i] ? Math.hypot(p[0] - part.places_mm[i][0], p[1] - part.places_mm[i][1]) : 0; sum += (length * (error[i] ** 2 + error[i + 1] ** 2)) / 2; weight += length; });
  return {
    outlines_mm: [faults.x, faults.y].map((side, k) => outline(side, axes[k].radius_mm, known.most_dent_mm)), radii_mm: axes.map((axis) => axis.radius_mm), bed_mm: known.bed_mm,
    marks_mm: known.marks_mm, errors_mm: off, rms_mm: Math.sqrt(off.reduce((total, [x, y]) => total + (x - middle[0]) ** 2 + (y - middle[1]) ** 2, 0) / off.length), big: known.big,
    part_mm: part.places_mm, printed_mm: printed, joined: part.joined, part_rms_mm: Math.sqrt(sum / weight), wall_mm: wall(faults.screw_mm, known.screw),
  };
}
