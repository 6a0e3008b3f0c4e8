"""A known printer whose belts or pulleys were worked on: measure again, or find where its motors stand by one print.

Until then nothing is mended. A pulley that was turned on its shaft moves its errors to other places, and mending would
add to them.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from printmend.effects import EFFECTS, scene_of
from printmend.effects.prior import wear_share
from printmend.errors import InputError, TraceError
from printmend.infer.phase import Phase, found_phase
from printmend.infer.update import Renewed, both_seen
from printmend.learn.learned import known_digests, near_bed
from printmend.learn.order import in_order, passed_over
from printmend.learn.walls import with_walls
from printmend.measure.checks import check_origin, counted_once, digest_of
from printmend.mend.update import Change, Updated, _updated, believed, measured_again
from printmend.messages import say, together
from printmend.model import SavedModel, screw_of, with_screw
from printmend.model.notes import REFITTED, REFUSAL, found_in
from printmend.path import Trace

LEAST_SHIFT_MM = 0.05  # of a motor that is told
MOST_NOISE = 2.0  # a print of the same machine may scatter by so many times the old measurement's noise
LEAST_NOISE_MM = 0.005  # of a measurement


def refitted(model: SavedModel, motors: Sequence[str]) -> SavedModel:
    """Return a model that refuses to mend until it is measured again, because the belts or pulleys of ``motors`` were
    worked on."""
    names = model.printer.motors
    if unknown := [name for name in motors if name.lower() not in names]:
        raise InputError(
            "--refitted", wanted=say("motor-of-this-printer", ", ".join(names)), came=unknown[0], todo=say("correct")
        )
    named = [name.upper() for name in names if name in {motor.lower() for motor in motors}]
    words = say("belt-pulley-worked-errors-elsewhere-now", named[0] if len(named) == 1 else say("and", *named))
    found = [one for one in found_in(model.document) if one.get("kind") != REFITTED]
    refusal = {"kind": REFITTED, "severity": REFUSAL, "size_mm": 0.0, "evidence": 0.0, "words": words}
    misfit = {"misfit": {"found": [refusal, *found]}}
    return with_screw(model, screw_of(model), findings=model.findings, details=misfit)


def learn_phase(old: SavedModel, trace: Trace, *, rng: np.random.Generator) -> Updated:
    """Return the same machine with the motor angles that a print shows.

    Raises `ModelError` for a model without drawn machines. Raises `TraceError` like `learn`, for a measurement that the
    model was learned from, and for a print of another machine.
    """
    check_origin(say("measurement-2"), trace.origin, old.printer)
    digest = digest_of(trace)
    if digest in known_digests(old):
        raise TraceError(
            say("measurement-2"), wanted=say("print-after-work"), came=say("measurement-model-learned-from"),
            todo=say("print-probe-phase"),
        )  # fmt: skip
    belief = believed(old)
    with threadpool_limits(1, user_api="blas"):
        once, copies = counted_once(trace)
        ordered = in_order(near_bed(with_walls(once, old.printer), old.printer), old.printer)
        if not ordered.trace.measured_rows.any() and not ordered.trace.wall_rows.any():
            raise TraceError(say("trace"), wanted=say("measured-marks"), came=say("none"), todo=say("check-trace"))
        scene = both_seen(belief.scene, scene_of(ordered.trace, old.printer, belief.scene.turns_mm))
        phase = found_phase(belief.parts, old.mechanism, ordered.trace, scene, max(old.noise_mm, LEAST_NOISE_MM))
        moved = replace(belief, parts=phase.parts)
        machine = replace(old, mechanism=phase.mechanism)
        found = measured_again(machine, moved, ordered.trace, rng, refit=True)
        foreign: list[str] = [*(say("another-drive") for _ in found.story.anew)]
        foreign += [name for name, _, _ in found.changes if not wear_share(name) and EFFECTS[name].from_home]
        noise_mm, own_mm = found.now.noise_mm, max(old.noise_mm, LEAST_NOISE_MM)
        if found.story.whole or foreign or noise_mm > MOST_NOISE * own_mm:
            scatter = say("marks-scatter-instead", f"{noise_mm:.3f}", f"{own_mm:.3f}")
            raise TraceError(
                say("phase-print"), wanted=say("machine-of-model-elsewhere"), todo=say("print-whole-and-learn-anew"),
                came=together(", ", dict.fromkeys(foreign)) if foreign else scatter,
            )  # fmt: skip
        # the work moved the motors, not the end stop, so the shift says nothing about the scatter of end stops
        updated = _updated(
            old, moved, replace(found, homed_mm=()), ordered.trace, (*passed_over(once, copies), *ordered.found), digest
        )
    # so small a print shows an idler's angle, and hardly its size
    changes = (
        *_shifts(old, phase),
        *_homes(old, found),
        *(one for one in updated.changes if not one.kind.startswith("period")),
    )
    screw = screw_of(old)
    model = updated.model
    if screw is not None:
        model = with_screw(model, screw, findings=model.findings, details={})
    return replace(updated, model=model, changes=changes)


def _homes(old: SavedModel, found: Renewed) -> list[Change]:
    """Return how far each belt rests at home from where it did: the work may have moved an end stop, too."""
    homes = []
    for motor, name in enumerate(old.printer.motors):
        before, now = found.of("place", motor)
        if now and ("place", motor) in [key[:2] for key in found.changes]:
            by_mm = float(sum(part.acts_mm[0] for part in now) - sum(part.acts_mm[0] for part in before))
            sd_mm = float(np.sum([part.draws_mm[0] for part in now], axis=0).std())
            words = say("motor-homes-elsewhere", name.upper(), f"{by_mm:+.2f}", f"{sd_mm:.2f}")
            homes.append(Change(name.upper(), "offset", 0.0, by_mm, sd_mm, "mm", words))
    return homes


def _shifts(old: SavedModel, phase: Phase) -> list[Change]:
    found = []
    for motor, name in enumerate(old.printer.motors):
        by_mm, sd_mm = float(phase.by_mm[motor]), float(phase.sd_mm[motor])
        if np.isfinite(sd_mm) and abs(by_mm) > max(LEAST_SHIFT_MM, 2 * sd_mm):
            words = say("motor-stands-elsewhere", name.upper(), f"{by_mm:+.2f}", f"{sd_mm:.2f}")
            found.append(Change(name.upper(), "phase", 0.0, by_mm, sd_mm, "mm", words))
    return found
