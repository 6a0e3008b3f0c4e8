"""What every world model, and the learner that makes it, must keep, on every printer and machine."""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, partial

import numpy as np

from printmend.corruption import HEALTHY
from printmend.learn import fit
from printmend.machine import PlayTables
from printmend.path import Trace
from printmend.printer import read_printer
from printmend.protocols import WorldModel
from printmend.twin import Twin
from printmend_lab.conformance.need import HARMLESS_STEPS, follow_tables, near, need, ring_layer
from printmend_lab.control.check import increments_by_advance, tables_of
from printmend_lab.control.registry import controller
from printmend_lab.published import layer_trace
from printmend_lab.sampling import sample

TRAINING = ring_layer((520.0, 540.0), 110.0)
OTHER = ring_layer((530.0, 530.0), 70.0, turn=0.7, index=1)
START = np.array([520, 540])
WORLDS = ("healthy", "gain-table", "pulley", "pulley-play")
PLANNED_TARGETS = 300  # of a layer, for a look at how it is planned
NOISE_MM = 0.05  # of a coordinate, as callipers have it
_TWINS: dict[tuple[str, str], Twin] = {}


@dataclass(frozen=True, eq=False)
class LearnerCandidate:
    """A learner by its name or place, and what it learned so far, for checks that look at the same model."""

    name: str
    models: dict[tuple[str, str, int, int], WorldModel] = field(default_factory=dict)

    def fitted(self, world: str, preset: str = "ender5", seed: int = 0, again: int = 0) -> WorldModel:
        """Return the model that was learned from the training layer's print in a world."""
        key = world, preset, seed, again
        if key not in self.models:
            twin = printed(world, preset)
            trace = layer_trace(TRAINING, twin.run(TRAINING.controls, TRAINING.start_steps), twin.printer)
            rng = np.random.default_rng(seed)
            self.models[key] = fit(self.name, trace, twin.printer, rng=rng, truth=twin.mechanism)
        return self.models[key]


def printed(world: str, preset: str) -> Twin:
    """Return a broken machine of a family, or a healthy one, always the same."""
    if (world, preset) not in _TWINS:
        corruption = HEALTHY if world == "healthy" else sample(world, np.random.default_rng(5))
        _TWINS[world, preset] = Twin.of(corruption, read_printer(preset))
    return _TWINS[world, preset]


def is_a_frozen_world_model(candidate: LearnerCandidate, world: str) -> None:
    """It has the methods, knows its printer, and cannot be changed."""
    model = candidate.fitted(world)
    need(isinstance(model, WorldModel), f"expected printer, start, advance and tabulate, found {type(model).__name__}")
    need(model.printer == read_printer("ender5"), f"expected the printer it was given, found {model.printer.name}")
    try:
        model.printer = read_printer("ender3")  # type: ignore[misc]
    except (dataclasses.FrozenInstanceError, AttributeError, TypeError):
        return
    need(False, "expected a frozen value (@dataclass(frozen=True)), found one whose printer can be changed")


def starts_where_the_layer_starts(candidate: LearnerCandidate, world: str) -> None:
    """The start is known: imagined = nominal there."""
    state = candidate.fitted(world).start(np.array([520, 431]))
    np.testing.assert_array_equal(state.nominal_steps, [[520, 431]])
    near(state.position_steps, np.array([[520.0, 431.0]]), "at the start")


def advance_agrees_with_tables(candidate: LearnerCandidate, world: str, c_max: int) -> None:
    """Planners read tables where there are some: they say what `advance` says."""
    model = candidate.fitted(world)
    tables = tables_of(model, START, c_max)
    if tables is None:
        return
    controls = random_controls(30, c_max, seed=1)
    state, positions = model.start(START), []
    for control in controls:
        state = model.advance(state, control[None])
        positions.append(state.position_steps[0])
    imagined = follow_tables(tables, model.printer, START, controls)[1:]
    near(imagined, np.array(positions), "tables beside `advance`")


def advance_takes_batches(candidate: LearnerCandidate, world: str) -> None:
    """K states after K controls from one state, or from K, are those that come one by one."""
    model = candidate.fitted(world)
    state = model.advance(model.start(START), np.array([[2, -1]]))
    controls = random_controls(20, 3, seed=2)
    batch = model.advance(state, controls)
    for k, control in enumerate(controls):
        alone = model.advance(state, control[None])
        near(batch[k].position_steps, alone.position_steps, "one of a batch beside itself alone")
        np.testing.assert_array_equal(batch[k].nominal_steps, alone.nominal_steps)
    together = model.advance(batch, controls[::-1].copy())
    alone = model.advance(batch[3], controls[::-1][3:4])
    near(together[3].position_steps, alone.position_steps, "one of a batch beside itself alone")


def rest_changes_nothing(candidate: LearnerCandidate, world: str) -> None:
    """The control (0, 0) leaves the imagined machine as it is."""
    model = candidate.fitted(world)
    state = model.advance(model.start(START), np.array([[3, -2]]))
    rested = model.advance(state, np.zeros((1, 2), int))
    near(rested.position_steps, state.position_steps, "at rest")
    np.testing.assert_array_equal(rested.nominal_steps, state.nominal_steps)


def longer_controls_move_farther(candidate: LearnerCandidate) -> None:
    """On a healthy printer a control of c steps moves c steps, also where the trace had single steps alone."""
    model = candidate.fitted("healthy")
    for control in (1, -1, 3, -3):
        moved = model.advance(model.start(START), np.full((1, 2), control)).position_steps[0] - START
        need(
            np.abs(moved - control).max() <= 0.5,
            f"expected a control of {control} to move about {control} full steps an axis, found {moved.round(2)}. "
            "A trace's ticks have controls of −1, 0 and 1: predict one step, and multiply",
        )


def learns_where_one_axis_rests(candidate: LearnerCandidate) -> None:
    """A trace along X alone, as measured sets have them, gives a model; Y is as commanded."""
    twin, x_mm = (
        printed("pulley", "ender5"),
        np.concatenate([np.arange(60.0, 160.0, 0.4), np.arange(160.0, 60.0, -0.4)]),
    )
    points = np.stack([x_mm, np.full(len(x_mm), 110.0)], axis=1)
    trace = Trace(points, twin.follow(points))
    model = fit(candidate.name, trace, twin.printer, rng=np.random.default_rng(0), truth=twin.mechanism)
    moved = model.advance(model.start(START), np.array([[1, 0]])).position_steps
    need(np.isfinite(moved).all(), f"expected finite positions, found {moved}")


def tables_are_sound(candidate: LearnerCandidate, world: str) -> None:
    """Tables are finite and of the bed's size; branches of play rise and lie the right way round."""
    model = candidate.fitted(world)
    tables = tables_of(model, START, 3)
    if isinstance(tables, PlayTables):
        for lower, upper in ((motor.lower_steps, motor.upper_steps) for motor in tables.motors):
            need((lower <= upper).all(), "expected lower ≤ upper everywhere")
            need((np.diff(lower) >= 0).all() and (np.diff(upper) >= 0).all(), "expected branches that never fall")


def is_planned_for(candidate: LearnerCandidate, world: str) -> str:
    """The best planner finds controls; say which it was, and why, where that is not `optimal` itself."""
    model, targets = candidate.fitted(world), OTHER.nominal_steps[: PLANNED_TARGETS + 1]
    plan = controller("optimal").plan(model, targets[1:], targets[0])
    need(np.isfinite(plan.imagined_steps).all(), "expected finite imagined positions")
    if not plan.planner:
        return "by `optimal`, on its tables of play"
    if tables_of(model, targets[0], 3) is not None:
        return f"by `{plan.planner}`, to which `optimal` leaves models whose tables know nothing of play"
    if increments_by_advance(model, targets[0]) is not None:
        return f"by `{plan.planner}`, on tables that were read off `advance`: it remembers nothing"
    return (
        f"by `{plan.planner}`, on `advance`, some hundred targets a second: it has no tables, and remembers or couples "
        "its axes"
    )


def seeds_repeat(candidate: LearnerCandidate) -> None:
    """The same trace and seed give the same model."""
    controls, ends = random_controls(50, 3, seed=1), []
    for again in range(2):
        model = candidate.fitted("pulley", again=again)
        ends.append(model.advance(model.start(START), controls).position_steps)
    near(ends[0], ends[1], "learned again")


def a_healthy_printer_is_left_alone(candidate: LearnerCandidate) -> None:
    """Planned with what was learned from a healthy printer, another layer is printed as wanted."""
    error = plan_error(printed("healthy", "ender5"), candidate.fitted("healthy"))
    need(error <= HARMLESS_STEPS, f"expected an RMSE of at most {HARMLESS_STEPS} full steps, found {error:.3f}")


def prints_another_layer_no_worse_than_naive(candidate: LearnerCandidate, world: str, preset: str) -> None:
    """Planned with the model, a layer that it has not seen is printed no worse than without."""
    twin = printed(world, preset)
    error, naive = plan_error(twin, candidate.fitted(world, preset)), naive_error(world, preset)
    need(error <= naive * 1.01, f"expected an RMSE of at most {naive:.3f} steps, as without a model, found {error:.3f}")


def sixty_noisy_points_do_no_harm(candidate: LearnerCandidate, world: str) -> None:
    """A callipers' trace: 60 points of two zigzags, 0.05 mm of noise, every third row and some coordinates missing."""
    twin, rng = printed(world, "ender5"), np.random.default_rng(4)
    turns = np.abs((np.linspace(0, 2, 60)[:, None] * (1.0, 1.5) + (0.0, 0.3)) % 2 - 1)
    points = 70.0 + 80.0 * turns
    measured = twin.follow(points) + rng.normal(0, NOISE_MM, points.shape)
    measured[rng.choice(60, 16, replace=False)] = np.nan
    measured[rng.choice(60, 4, replace=False), 0] = np.nan
    model = fit(candidate.name, Trace(points, measured), twin.printer, rng=rng, truth=twin.mechanism)
    # With play Algorithm 1 deadlocks even on the true machine (physics.md §6).
    error = plan_error(twin, model, "lookahead" if world == "pulley-play" else "greedy")
    most = naive_error(world, "ender5") + 2 * NOISE_MM / 0.2
    need(error <= most, f"expected an RMSE of at most {most:.3f} steps, found {error:.3f}")


def plan_error(twin: Twin, model: WorldModel, planner: str = "greedy") -> float:
    """Print another layer, planned with the model, and return the RMSE [steps]."""
    targets = OTHER.nominal_steps
    plan = controller(planner).plan(model, targets[1:], targets[0])
    return float(np.sqrt(((twin.run(plan.controls, targets[0]) - targets) ** 2).sum(axis=1).mean()))


@cache
def naive_error(world: str, preset: str) -> float:
    """Return the RMSE [steps] of the layer printed as it is."""
    return plan_error(printed(world, preset), LearnerCandidate("naive").fitted(world, preset))


def random_controls(count: int, c_max: int, *, seed: int) -> np.ndarray:
    """Return controls [count, 2] in −c_max…c_max."""
    return np.random.default_rng(seed).integers(-c_max, c_max + 1, (count, 2))


CHECKS: dict[str, Callable[[LearnerCandidate], str | None]] = {
    **{f"is a frozen world model ({w})": partial(is_a_frozen_world_model, world=w) for w in WORLDS},
    **{f"starts where the layer starts ({w})": partial(starts_where_the_layer_starts, world=w) for w in WORLDS},
    **{
        f"advance agrees with the tables ({w}, controls to {c})": partial(advance_agrees_with_tables, world=w, c_max=c)
        for w in WORLDS
        for c in (1, 3, 5)
    },
    **{f"advance takes batches ({w})": partial(advance_takes_batches, world=w) for w in WORLDS},
    **{f"rest changes nothing ({w})": partial(rest_changes_nothing, world=w) for w in WORLDS},
    "longer controls move farther": longer_controls_move_farther,
    "learns where one axis rests": learns_where_one_axis_rests,
    **{f"tables are sound ({w})": partial(tables_are_sound, world=w) for w in WORLDS},
    **{f"is planned for ({w})": partial(is_planned_for, world=w) for w in ("pulley-play",)},
    "seeds repeat": seeds_repeat,
    "a healthy printer is left alone": a_healthy_printer_is_left_alone,
    **{
        f"another layer is printed no worse than without a model ({w}, {p})": partial(
            prints_another_layer_no_worse_than_naive, world=w, preset=p
        )
        for w in ("gain-table", "pulley")
        for p in ("ender5", "corexy")
    },
    **{
        f"sixty noisy points do no harm ({w})": partial(sixty_noisy_points_do_no_harm, world=w)
        for w in ("healthy", "pulley", "pulley-play")
    },
}
