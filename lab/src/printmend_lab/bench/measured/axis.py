"""A measured set laid along the x axis of a printer, so that a learner of printers can learn it."""

from dataclasses import dataclass, replace

import numpy as np

from printmend.path import Trace
from printmend.printer import Printer, read_printer
from printmend.protocols import WorldModel
from printmend_lab.bench.measured.tracks import MeasuredSet, Track, less_free, span

_PRESET = "ender5"  # with pulleys of 20 teeth: that one turns by another length, the learner has to find
_SPAN_MM = 160.0  # to which inputs of another kind are stretched
_MARGIN_MM = 20.0  # of the axis beyond either end
_FEWEST_CORRELATED = 0.3  # below this correlation the spreads, not a line, say how an output is stretched


@dataclass(frozen=True, eq=False)
class Bench:
    """A printer whose x axis is long enough, and the line from the set's units to it: mm = shift + scale·value."""

    printer: Printer
    input_scale: float
    input_shift_mm: float
    output_scale: float
    output_shift_mm: float
    joined: bool

    def laid(self, track: Track) -> Track:
        """Return a track in mm of the axis, the run-up too."""
        commanded = self.input_shift_mm + self.input_scale * track.commanded
        measured = self.output_shift_mm + self.output_scale * track.measured
        return Track(commanded, measured, self.input_scale * track.run_up)

    def trace(self, tracks: tuple[Track, ...]) -> Trace:
        """Return the trace of tracks in the set's units; y rests in the middle of its axis."""
        middle = (self.printer.y.min_mm + self.printer.y.max_mm) / 2
        parts = []
        for number, track in enumerate(map(self.laid, tracks)):
            x, u = track.commanded, track.measured
            if track.run_up:
                x, u = np.concatenate([[x[0] + track.run_up], x]), np.concatenate([[np.nan], u])
            parts.append(np.stack([x, u, np.full(len(x), number)], axis=1))
        x, u, number = np.concatenate(parts).T
        y = np.full(len(x), middle)
        measured = np.stack([u, np.where(np.isnan(u), np.nan, y)], axis=1)
        return Trace(np.stack([x, y], axis=1), measured, layer=None if self.joined else number.astype(int))

    def missed(self, model: WorldModel, tracks: tuple[Track, ...], free: str) -> np.ndarray:
        """Return what a model did not foresee [N] of tracks in the set's units, less what is free, in mm."""
        return np.concatenate([self._missed(model, self.laid(track), free) for track in tracks])

    def _missed(self, model: WorldModel, track: Track, free: str) -> np.ndarray:
        pitch = self.printer.mm_per_step[0]
        places = np.rint(
            (np.append(track.commanded[:1] + track.run_up, track.commanded) - self.printer.x.min_mm) / pitch
        )
        y = round(self.printer.bed_steps[1] / 2)
        state, errors = model.start(np.array([places[0], y], np.int64)), []
        for step in np.diff(places).astype(np.int64):
            if step:
                state = model.advance(state, np.array([[step, 0]]))
            errors.append(state.position_steps[0, 0] - state.nominal_steps[0, 0])
        imagined = track.commanded + np.array(errors) * pitch
        known = np.isfinite(track.measured)
        return less_free(track, track.measured - imagined, free)[known]  # type: ignore[arg-type]


def bench_of(item: MeasuredSet) -> Bench:
    """Lay a set along an axis. Only what is learned from says how an output of another kind is stretched."""
    low, high = span((*item.learned, *item.judged))
    scale = item.mm_per_unit or _SPAN_MM / (high - low)
    printer = read_printer(_PRESET)
    turn = printer.x.mm_per_turn
    turns = np.ceil(((high - low) * scale + 2 * _MARGIN_MM) / turn)
    printer = replace(printer, x=replace(printer.x, min_mm=0.0, max_mm=float(turns * turn)))
    shift = float(turns * turn) / 2 - (low + high) / 2 * scale
    commanded = shift + scale * np.concatenate([track.commanded for track in item.learned])
    measured = np.concatenate([track.measured for track in item.learned])
    known = np.isfinite(measured)
    commanded, measured = commanded[known], measured[known]
    if item.mm_per_unit is not None:
        level = shift if item.free == "start" else float((commanded - scale * measured).mean())
        return Bench(printer, scale, shift, scale, level, item.joined)
    spread = float(measured.std()) or 1.0
    correlation = float(((commanded - commanded.mean()) * (measured - measured.mean())).mean()) / (
        commanded.std() * spread
    )
    slope = correlation if abs(correlation) >= _FEWEST_CORRELATED else float(np.copysign(1.0, correlation))
    output = float(commanded.std()) / (spread * slope)
    return Bench(printer, scale, shift, output, float(commanded.mean() - output * measured.mean()), item.joined)
