"""A scanner whose carriage runs unevenly: a random error along its travel, and across it where the carriage yaws."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import GONE, Of, Places, Scene, Term, Usual
from printmend.effects.prior import alternatives, each_share, numbers_of, share_of
from printmend.effects.process import cosines, share_of_span, smooth, walk
from printmend.effects.words import PLACES, Found, Told, Whole
from printmend.messages import say


class Carriage(Usual):
    """Cosines of the position along one axis of the picture, weighted as for a random walk or, as of an uneven belt,
    for a smooth process. They move the coordinate along the carriage's travel, where its motor's steps jitter from line
    to line, or, with fewer, both coordinates."""

    name = "carriage"
    of = Of.INSTRUMENT
    fate = GONE
    keys = Whole()

    def terms(self, scene: Scene) -> Iterator[Term]:
        if scene.instrument.wave_mm:
            counts = numbers_of(self.name, "cosines")
            share = each_share(share_of(self.name), len(counts))
            for axis in range(2):
                for ways, count in enumerate(map(int, counts), start=1):
                    lengths = numbers_of("uneven", "lengths")
                    usual = [walk(count), *(smooth(scene.bed_span_mm[axis], each, count) for each in lengths)]
                    profiles = (ways * each for each in usual)
                    yield from alternatives(self.name, axis, [(float(count), float(ways))], *profiles, share=share)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        count, ways = map(int, shape)
        across, spans = scene.instrument.ways, np.array(scene.bed_span_mm)
        half_mm = np.abs(across[where]) @ np.ptp(spans, axis=1) / 2
        span_mm = across[where] @ spans.mean(axis=1) + half_mm * np.array([-1.0, 1.0])
        moved = cosines(np.clip(share_of_span(places.bed_mm @ across[where], span_mm), 0.0, 1.0), count)
        return np.concatenate([moved[:, None, :] * across[axis][:, None] for axis in (where, 1 - where)[:ways]], axis=2)

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        count, ways = map(int, found.shape)
        moved = cosines(np.linspace(0.0, 1.0, PLACES), count) @ found.sizes_mm.reshape(ways, count).T
        largest = float(np.linalg.norm(moved, axis=1).max())
        words = say("scanner-carriage-runs-unevenly-along-up", "XY"[found.where], f"{largest:.2f}")
        yield Told("carriage", words, is_harmless=True)
