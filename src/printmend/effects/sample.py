"""Draw an effect from its prior; draw places over the measured spans, to judge an effect's size on."""

from dataclasses import replace

import numpy as np

from printmend.effects.effect import LONG_MOVE_MM, Effect, Places, Scene, Term

COUNT = 600  # of the places
DAMAGED_SHARE = 0.4  # an alternative with smaller sizes is a mild one, as priors.toml has them


def drawn_places(scene: Scene) -> Places:
    """Return places over the measured spans, each reached from either side, by short and by long moves."""
    rng = np.random.default_rng(0)
    low, high = np.array(scene.bed_span_mm).T
    bed = rng.uniform(low, high, (COUNT, 2))
    side, ways = rng.choice([-1.0, 1.0], (2, COUNT, 2))
    normal = rng.standard_normal((COUNT, 2))
    return Places(
        scene.printer.to_motor(bed), side, bed, ways, -side, rng.uniform(0, 1, COUNT),
        rng.choice([1.0, LONG_MOVE_MM], COUNT), normal / np.linalg.norm(normal, axis=1, keepdims=True),
        np.linspace(scene.layers[0], scene.layers[1], COUNT) if scene.layers else None, rng.standard_normal((COUNT, 2)),
    )  # fmt: skip


def terms_of(effect: Effect, scene: Scene) -> list[Term]:
    """Return an effect's terms on a machine, those of a measurement without a place included."""
    return list(effect.terms(scene)) or list(effect.terms(replace(scene, placed=False)))


def drawn_term(terms: list[Term], rng: np.random.Generator) -> tuple[Term, np.ndarray]:
    """Draw one of some terms for a damaged machine: its shape evenly, its sizes [P] by the prior.

    The mild alternatives of a shape are left out.
    """
    shape = terms[int(rng.integers(len(terms)))].shape
    alike = [term for term in terms if term.shape == shape]
    most = max(float(np.linalg.norm(term.sd_mm)) for term in alike)
    alike = [term for term in alike if np.linalg.norm(term.sd_mm) > DAMAGED_SHARE * most]
    term = alike[int(rng.integers(len(alike)))]
    return term, drawn_sizes(term, rng)


def drawn_sizes(term: Term, rng: np.random.Generator) -> np.ndarray:
    """Draw the sizes [P] of a term by its prior."""
    sizes = np.array(term.sd_mm) * rng.standard_normal(len(term.sd_mm))
    return np.abs(sizes) if term.positive else sizes
