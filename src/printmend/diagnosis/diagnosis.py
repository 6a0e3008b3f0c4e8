"""A learned machine in plain words: what is wrong, how sure that is, what the trace could not tell.

Harmonic k of a branch has the amplitude c_k/k in position, where c_k is that of the pulley's support function h
(physics.md eq. 2): c_1 is the eccentricity of the bore, c_2 makes an oval, larger k corners.
"""

from dataclasses import dataclass, replace

import numpy as np

from printmend.diagnosis.gaps import gaps_of
from printmend.diagnosis.named import Diagnosis
from printmend.effects.pulley import shape_words
from printmend.effects.words import NAMED_SIGMAS, amount
from printmend.effects.words import Fault as NamedFault
from printmend.identify.drive import Jump
from printmend.identify.drive.period import NEAR_SHARE, TOOTH_MM
from printmend.learn.greybox import GreyboxModel, LearnedDrive
from printmend.machine import Frame
from printmend.path import Trace
from printmend.printer import Printer

LEAST_FAULT_MM = 0.002  # … and than this: smaller faults move no print
LEAST_SCALE_PERCENT = 0.005  # a smaller wrong scale is not named
NAMED_HARMONICS = 3  # most harmonics of a pulley that are named: the largest
OPPOSITE_SHARE = 0.05  # share of two scale errors' difference that their sum may be for them to count as opposite
LEAST_SHOWN_MM = 0.005  # a smaller fault whose size is said with two decimals would be said to be 0.00
LEAST_EFFECT_MM = 0.003  # a wave that shifts a print by less is not named: no print shows it
GUIDE_PLACES = 41  # places along either axis of the bed at which wavy guides are looked at


@dataclass(frozen=True)
class Doubt:
    """What all points of a measurement share and no fit can see: standard deviations added to the fit's own.

    ``scale_percent`` of the measured lengths, ``skew_deg`` of its axes, ``wave_mm`` of a slow unevenness. ``placed``
    says whether the measurement tells where on the bed things lie: else a shift of all of it is its own, and no fault.
    """

    scale_percent: float = 0.0
    skew_deg: float = 0.0
    wave_mm: float = 0.0
    placed: bool = True


def doubt_of(trace: Trace) -> Doubt:
    """Return the doubt about a trace that its instrument brings in."""
    unsure = trace.instrument_doubt
    percent = 100 * float(np.hypot(unsure.scale_sd, unsure.axes_sd))
    return Doubt(percent, float(np.degrees(2 * unsure.lean_sd)), unsure.wave_mm, trace.placed)


def diagnose(model: GreyboxModel, doubt: Doubt = Doubt()) -> Diagnosis:
    """Name the faults of a learned machine."""
    parts: list[str] = []
    faults: list[NamedFault] = []
    own = [
        [*drive_faults(drive, doubt, axis.mm_per_turn), *_jumps(drive, jumps)]
        for drive, jumps, axis in zip(model.drives, model.jumps, model.printer.axes[:2], strict=True)
    ]
    crooked = _frame_faults(model, doubt)
    own = _without_the_frames_shift(model, own) if crooked else own
    if model.printer.kinematics == "corexy":
        own, crooked = _skew_first(model, doubt, own, crooked)
        unlike = any(fault.kind == "axes" for fault in crooked)  # no motor's: the frame is surely not as it should be
        own = or_a_skew(own, "or" if unlike else "or, less likely,") if unlike or not (doubt.placed or crooked) else own
    for drive, found in zip(model.drives, own, strict=True):
        faults += found
        words = ", ".join(fault.words for fault in found)
        parts.append(f"{drive.name.upper()} {words or 'healthy'}")
    faults += crooked
    if crooked:
        parts.append("frame " + ", ".join(fault.words for fault in crooked))
    return Diagnosis(tuple(faults), "; ".join(parts), gaps_of(model))


def drive_faults(drive: LearnedDrive, doubt: Doubt, turn_mm: float) -> list[NamedFault]:
    """Name the faults of one motor's drive, the pulley first; ``turn_mm`` is a turn of the printer's own."""
    return [
        *_scale(drive, doubt, turn_mm),
        *_pulley(drive, doubt, turn_mm),
        *_play(drive, doubt),
        *_other_faults(drive, doubt),
    ]


def _fault(drive: LearnedDrive, kind: str, value: float, sd: float, words: str, unit: str = "mm") -> NamedFault:
    return NamedFault(drive.name, kind, float(value), float(sd), unit, words)


def _scale(drive: LearnedDrive, doubt: Doubt, turn_mm: float) -> list[NamedFault]:
    powers = drive.branches.mean.powers_mm
    if len(powers) < 2 or not powers[1]:
        return []
    percent, sd = float(powers[1]), float(np.hypot(_scale_sd(drive), doubt.scale_percent))  # mm in 100 mm
    if abs(percent) < NAMED_SIGMAS * sd or abs(percent) < LEAST_SCALE_PERCENT:
        return []
    learned_mm = drive.branches.period_mm  # of a pulley, if it has teeth: else of an idler or the belt
    toothed = abs(learned_mm / TOOTH_MM - round(learned_mm / TOOTH_MM)) < 1e-9
    radius = (learned_mm if toothed else turn_mm) / (2 * np.pi)
    found = amount(radius * (1 + percent / 100), radius * sd / 100)
    digits = 3 if abs(radius * percent / 100) >= 0.001 else 4  # never a number instead of itself
    words = f"pulley radius {found} instead of {radius:.{digits}f}"
    return [_fault(drive, "scale", percent, sd, words, "%")]


def _pulley(drive: LearnedDrive, doubt: Doubt, turn_mm: float) -> list[NamedFault]:
    """Name the largest harmonics of the pulley; those of a loose belt's play are twice the pulley's odd ones.

    What turns by another length than the printer's pulley, ``turn_mm``, may be an idler as well.
    """
    design, values, sds = drive.choice.design, drive.choice.fit.posterior.values, drive.choice.fit.posterior.sds
    loose = drive.structure.play == "loose"
    found: dict[int, tuple[float, float]] = {}
    for name, share in (("mean", 1.0), ("play", 0.5 if loose else 0.0)):
        for i, k in enumerate(design.waves(name)):
            at = design.wave_at(name, i)
            size = float(np.hypot(*values[at])) * share * k
            sd = float(np.hypot(np.sqrt(np.mean(sds[at] ** 2)), doubt.wave_mm)) * share * k
            if share and size > max(NAMED_SIGMAS * sd, LEAST_FAULT_MM, LEAST_EFFECT_MM * k):
                found[int(k)] = (size, sd)
    largest = sorted(found, key=lambda k: -found[k][0])
    if largest and abs((learned_mm := drive.branches.period_mm) / turn_mm - 1) >= NEAR_SHARE:
        k = max(found, key=lambda k: found[k][0] / k)
        size, sd = (each / k for each in found[k])
        words = f"idler or pulley uneven, every {learned_mm / k:.1f} mm, by {amount(size, sd)}"
        return [_fault(drive, f"period-{learned_mm / k:.1f}", size, sd, words)]
    faults: list[NamedFault] = []
    for k in sorted(largest[:NAMED_HARMONICS]):
        words = f"{'pulley ' if not faults else ''}{shape_words(k)} {amount(*found[k])}"
        faults.append(_fault(drive, f"harmonic-{k}", *found[k], words))
    if len(largest) > NAMED_HARMONICS and faults:
        last = faults[-1]
        words = f"{last.words} and {len(largest) - NAMED_HARMONICS} finer"
        faults[-1] = _fault(drive, last.kind, last.value, last.sd, words)
    return faults


def _play(drive: LearnedDrive, doubt: Doubt) -> list[NamedFault]:
    if drive.structure.play == "none":
        return []
    branches, post = drive.branches, drive.choice.fit.posterior
    motor = np.linspace(*branches.reach_mm, 2001)
    _, play = branches.errors_mm(motor)
    # the mean's, not the middle's: play that grows along the axis is known better as a whole than at any one place
    columns = drive.choice.design.columns(motor, branches.period_mm, branches.middle_mm)[1].mean(axis=0)[post.active]
    sd = float(np.hypot(np.sqrt(columns @ post.covariance @ columns), doubt.wave_mm / 2))
    value = float(play.mean())
    if value <= NAMED_SIGMAS * sd:  # 0 where it was left out: no more than the instrument makes
        return []
    smallest, largest = float(play.min()), float(play.max())
    if drive.structure.play == "constant" and not drive.structure.friction:
        return [_fault(drive, "play", value, sd, f"belt play {amount(value, sd)}")]
    kind, name = {
        "constant": ("friction", "lost motion that grows along the axis"),
        "loose": ("loose-belt", "loose belt, play"),
        "free": ("play-by-angle", "play that follows the motor's angle"),
    }[drive.structure.play]
    if drive.structure.friction and drive.structure.play != "constant":
        name += " and position"
    words = f"{name} {amount(value, sd)} ({smallest:.2f} to {largest:.2f})"
    return [_fault(drive, kind, value, sd, words)]


def _other_faults(drive: LearnedDrive, doubt: Doubt) -> list[NamedFault]:
    faults: list[NamedFault] = []
    structure, branches = drive.structure, drive.branches
    motor = np.linspace(*branches.reach_mm, 2001)
    if structure.ripple:
        size = max((branches.mean.amplitude_mm(int(k)) for k in drive.choice.design.ripple), default=0.0)
        faults.append(_fault(drive, "ripple", size, 0.0, f"micro-step ripple {size:.3f} mm"))
    if structure.second_mm:
        faults += _second(drive, doubt)
    if structure.elastic:
        faults += _elastic(drive, doubt)
    if structure.drift:
        x = (motor - branches.middle_mm) / 100.0
        bend = branches.mean.polynomial_mm(x) - np.polyval(np.polyfit(x, branches.mean.polynomial_mm(x), 1), x)
        size = float(np.abs(bend).max())
        if size >= LEAST_SHOWN_MM:
            faults.append(_fault(drive, "drift", size, 0.0, f"scale that changes along the axis, up to {size:.2f} mm"))
    if structure.warp_mm:
        bare = replace(branches, warp_mm=np.zeros(0))
        size = float(np.abs(branches.errors_mm(motor)[0] - bare.errors_mm(motor)[0]).max())
        words = f"uneven belt or guide that repeats nothing, up to {size:.2f} mm"
        if size >= LEAST_SHOWN_MM:
            faults.append(_fault(drive, "warp", size, 0.0, words))
    if structure.offset and not (structure.scale or structure.pulley != "none" or structure.play != "none" or faults):
        value = float(branches.mean.powers_mm[0])
        sd = float(drive.choice.fit.posterior.sds[drive.choice.design.place_at])
        if doubt.placed and abs(value) > LEAST_FAULT_MM:
            faults.append(_fault(drive, "offset", value, sd, f"shifted by {amount(value, sd)}"))
    return faults


def _elastic(drive: LearnedDrive, doubt: Doubt) -> list[NamedFault]:
    """Name the largest wave that changes along the axis: by how much it changes from one end to the other.

    Where that of the pulley's eccentricity alone does, an idler of nearly the pulley's size would do the same.
    """
    branches, design = drive.branches, drive.choice.design
    span = (branches.reach_mm[1] - branches.reach_mm[0]) / 100.0
    sizes = np.hypot(branches.elastic.cos_mm, branches.elastic.sin_mm)
    if not len(sizes):
        return []
    largest = int(np.argmax(sizes))
    sds = drive.choice.fit.posterior.sds
    each_sd = [float(np.sqrt(np.mean(sds[design.wave_at("elastic", i)] ** 2))) for i in range(len(sizes))]
    size, sd = float(sizes[largest]) * span, each_sd[largest] * span
    sd = float(np.hypot(sd, 2 * doubt.wave_mm))  # two ends, each with its own
    if size < max(NAMED_SIGMAS * sd, LEAST_EFFECT_MM):
        return []
    surely = sizes > NAMED_SIGMAS * np.array(each_sd)
    what = "elastic belt: odd errors of the pulley fade along the axis"
    if not surely[branches.elastic.harmonics > 1].any():
        what = "elastic belt, or an idler of nearly the pulley's size: the pulley's error changes along the axis"
    words = f"{what}, by {amount(size, sd)}"
    return [_fault(drive, "elastic", size, sd, words)]


def _second(drive: LearnedDrive, doubt: Doubt) -> list[NamedFault]:
    """Name an error that repeats with another length than the turn, by its largest wave."""
    branches, design = drive.branches, drive.choice.design
    sizes = np.hypot(branches.second.cos_mm, branches.second.sin_mm)
    if not sizes.any():
        return []
    largest, period_mm = int(np.argmax(sizes)), branches.second_mm
    sds = drive.choice.fit.posterior.sds[design.wave_at("second", largest)]
    size, sd = float(sizes[largest]), float(np.hypot(np.sqrt(np.mean(sds**2)), doubt.wave_mm))
    words = f"idler or belt uneven, every {period_mm:.1f} mm, by {amount(size, sd)}"
    return [_fault(drive, f"period-{period_mm:.1f}", size, sd, words)]


def _jumps(drive: LearnedDrive, jumps: tuple[Jump, ...]) -> list[NamedFault]:
    """Name what happened while the trace was printed; the model cannot mend it."""
    faults = []
    for belt, what in ((True, "skipped tooth"), (False, "loss of steps")):
        these = [jump for jump in jumps if jump.belt == belt]
        if not these:
            continue
        rows = ", ".join(str(jump.row) for jump in these[:4]) + (", …" if len(these) > 4 else "")
        total = sum(jump.size_mm for jump in these)
        words = f"{len(these)} × {what} of {abs(these[0].size_mm):.1f} mm in this print (at row {rows})"
        faults.append(_fault(drive, "jump", total if total else these[0].size_mm, 0.0, words))
    return faults


def _without_the_frames_shift(model: GreyboxModel, own: list[list[NamedFault]]) -> list[list[NamedFault]]:
    """Leave out a motor's shift that only takes a crooked frame's back: at home, by definition, nothing has moved."""
    home = np.array(model.printer.home_mm)
    by_frame = model.printer.to_motor(model.mechanism.frame.apply(home) - home)
    return [
        [
            one
            for one in found
            if one.kind != "offset" or abs(one.value + by_frame[motor]) > LEAST_FAULT_MM + NAMED_SIGMAS * one.sd
        ]
        for motor, found in enumerate(own)
    ]


def _frame_faults(model: GreyboxModel, doubt: Doubt) -> list[NamedFault]:
    frame, printer = model.mechanism.frame, model.printer
    if frame.is_identity:
        return []
    frame, wavy = replace(frame, waves=frame.waves[:0]), _wavy(frame, printer)
    middle = np.array(printer.middle_mm)
    right, up = (frame.apply(middle + step) - frame.apply(middle - step) for step in np.eye(2))
    right, up = right / 2, up / 2
    skew = float(np.degrees(np.arctan2(up[0], up[1]) + np.arctan2(right[1], right[0])))
    sd = float(np.degrees(np.hypot(_skew_sd(model.drives[0]), _skew_sd(model.drives[1]))))
    sd = float(np.hypot(sd, doubt.skew_deg))
    faults = [*wavy]
    if abs(skew) > max(NAMED_SIGMAS * sd, 0.001):
        faults.append(NamedFault("frame", "skew", skew, sd, "°", f"skewed by {amount(skew, sd, '°')}"))
    if printer.kinematics == "corexy":  # another printer's motors have the sizes of their axes
        faults += _unlike_axes(model, doubt, 100 * float(right[0] - up[1]))
    if any(choice.cross > 1 for choice in (drive.structure for drive in model.drives)):
        corners = np.array(
            [[x, y] for x in (printer.x.min_mm, printer.x.max_mm) for y in (printer.y.min_mm, printer.y.max_mm)]
        )
        bent = frame.apply(corners) - (frame.apply(middle[None]) + (corners - middle) @ np.stack([right, up]))
        size = float(np.linalg.norm(bent, axis=1).max())
        faults.append(NamedFault("frame", "bow", size, 0.0, "mm", f"bent guides, up to {size:.2f} mm at the corners"))
    return faults


def _unlike_axes(model: GreyboxModel, doubt: Doubt, percent: float) -> list[NamedFault]:
    """Name the axes of a CoreXY that print unlike sizes: both motors move both, so that no motor's scale does that."""
    sd = 100 * float(np.hypot(_skew_sd(model.drives[0]), _skew_sd(model.drives[1])))
    sd = float(np.hypot(sd, 2 * doubt.scale_percent))
    if abs(percent) < max(NAMED_SIGMAS * sd, LEAST_SCALE_PERCENT):
        return []
    words = f"X prints {amount(abs(percent), sd, '%')} {'larger' if percent > 0 else 'smaller'} than Y"
    return [NamedFault("frame", "axes", percent, sd, "%", words)]


def _wavy(frame: Frame, printer: Printer) -> list[NamedFault]:
    """Name guides that are wavy, by how far they push at most."""
    if not len(frame.waves):
        return []
    x, y = (np.linspace(axis.min_mm, axis.max_mm, GUIDE_PLACES) for axis in (printer.x, printer.y))
    pushed = frame.waves_at_mm(np.stack(np.meshgrid(x, y), axis=-1))
    size = float(np.linalg.norm(pushed, axis=-1).max())
    lengths = " and ".join(f"{wave[1]:.0f}" for wave in frame.waves)
    words = f"wavy guides, up to {size:.2f} mm, every {lengths} mm"
    return [NamedFault("frame", "wavy", size, 0.0, "mm", words)]


def _skew_first(
    model: GreyboxModel, doubt: Doubt, own: list[list[NamedFault]], crooked: list[NamedFault]
) -> tuple[list[list[NamedFault]], list[NamedFault]]:
    """Name a CoreXY's skew where its motors seem to have opposite scale errors: these come from one crooked frame.

    With x' = x + γy the motors' sums x ± y grow by ± γ/2; that two pulleys are wrong by so much, one too large and one
    too small, is a coincidence. Both are said, the likelier first. What the motors' scales have in common is doubted as
    the instrument's scale, and what they differ by as its lean: a scan knows right angles better than lengths.
    """
    scales = [drive.branches.mean.powers_mm for drive in model.drives]  # the second: mm in 100 mm
    if any(len(powers) < 2 or abs(powers[1]) < LEAST_SCALE_PERCENT for powers in scales):
        return own, crooked
    (a, b), sd = (float(powers[1]) for powers in scales), _scales_sd(model)
    skew, skew_sd = float(np.degrees((a - b) / 100)), float(np.hypot(np.degrees(sd / 100), doubt.skew_deg))
    common_sd = float(np.hypot(sd, 2 * doubt.scale_percent))
    alike = abs(a + b) > max(NAMED_SIGMAS * common_sd, OPPOSITE_SHARE * abs(a - b))
    if a * b >= 0 or alike or abs(skew) < NAMED_SIGMAS * skew_sd:
        return own, crooked
    words = (
        f"skewed by {amount(skew, skew_sd, '°')} (or, less likely, motor A's pulley is {abs(a):.2f} % too "
        f"{'large' if a > 0 else 'small'} and B's {abs(b):.2f} % too {'large' if b > 0 else 'small'}, which looks the "
        "same)"
    )
    fault = NamedFault("frame", "skew", skew, skew_sd, "°", words)
    rest = [[each for each in found if each.kind != "scale"] for found in own]
    return rest, [fault, *(each for each in crooked if each.kind != "skew")]


def _scales_sd(model: GreyboxModel) -> float:
    """Return the standard deviation [%] of the sum of both motors' scales by the scatter of the points alone."""
    return float(np.hypot(_scale_sd(model.drives[0]), _scale_sd(model.drives[1])))


def or_a_skew(own: list[list[NamedFault]], how_likely: str) -> list[list[NamedFault]]:
    """Name the other cause of a CoreXY's wrong pulleys: motors whose scales are off by a and b stretch the bed by
    (a + b)/2 and make it lean by a − b, as a skewed frame of a wrong size does. ``how_likely`` begins its words."""
    scales = [fault for found in own for fault in found if fault.kind == "scale"]
    if not scales:
        return own
    named = max(scales, key=lambda fault: abs(fault.value))
    a, b = (sum(fault.value for fault in found if fault.kind == "scale") for found in own)
    skew, wide, sd = float(np.degrees((a - b) / 100)), (a + b) / 2, max(fault.sd for fault in scales)
    if abs(a - b) < NAMED_SIGMAS * np.sqrt(2) * sd:
        return own
    size = f" and prints {abs(wide):.2f} % too {'large' if wide > 0 else 'small'}" if abs(wide) > sd else ""
    words = f"{named.words} ({how_likely} the frame is skewed by {skew:.2f}°{size}, which looks the same)"
    return [[replace(each, words=words) if each is named else each for each in found] for found in own]


def _scale_sd(drive: LearnedDrive) -> float:
    """Return the standard deviation [%] of one motor's scale by the scatter of the points alone."""
    return float(drive.choice.fit.posterior.sds[drive.choice.design.scale_at])


def _skew_sd(drive: LearnedDrive) -> float:
    """Return the standard deviation [rad] of the lean of one motor's axis, 0 where no frame was fitted."""
    design = drive.choice.design
    return float(drive.choice.fit.posterior.sds[design.cross_at]) / 100.0 if design.cross else 0.0
