"""What every controller must keep, whatever tables the model has."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial

import numpy as np

from printmend.corruption import HEALTHY
from printmend.errors import InputError
from printmend.learn.mechanism_model import MechanismModel, NaiveModel
from printmend.printer import Printer, read_printer
from printmend.protocols import JointTables, State, WorldModel
from printmend.twin import Twin
from printmend_lab.conformance.need import joint_step, need, ring_layer
from printmend_lab.control.registry import controller
from printmend_lab.protocols import Controller
from printmend_lab.sampling import sample

LAYER = ring_layer((530.0, 530.0), 18.0, turn=0.7, gap=9.0)
TARGETS, START = LAYER.nominal_steps[1:], LAYER.start_steps
KINDS = ("play", "corexy", "increments", "joint")
STRAIGHT = ("pulley", "published", "eccentric", "play", "pulley-play", "friction")
PRESETS = ("ender5", "ender3", "corexy")


@dataclass(frozen=True)
class ControllerCandidate:
    """A controller by its name or place."""

    name: str

    @property
    def controller(self) -> Controller:
        """The controller itself; what one of another package plans is checked."""
        return controller(self.name)


@dataclass(frozen=True, eq=False)
class JointFault:
    """A world model with `JointTables`: what a step does depends on the cell and on both signs, as in the paper."""

    printer: Printer
    tables: JointTables

    def start(self, start_steps: np.ndarray) -> State:
        """Return the known state of the layer's start."""
        return State.at(start_steps)

    def advance(self, state: State, controls: np.ndarray) -> State:
        """Follow the tables' definition, one machine after the other."""
        nominal = np.broadcast_to(state.nominal_steps, controls.shape)
        pairs = zip(nominal, controls, strict=True)
        moved = np.array([joint_step(self.tables, self.printer, at, control) for at, control in pairs])
        return State(np.clip(nominal + controls, 0, self.printer.bed_steps), state.position_steps + moved)

    def tabulate(self, start_steps: np.ndarray, *, c_max: int = 3) -> JointTables:
        """Return the tables."""
        return self.tables


@cache
def faulty_model(kind: str) -> WorldModel:
    """Return a faulty model of a kind of tables."""
    rng = np.random.default_rng(3)
    if kind == "joint":
        printer = read_printer("ender5")
        cells = [np.arange(steps + 1) // 20 % 9 for steps in printer.bed_steps]
        signs = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1], indexing="ij"), axis=-1)
        unit_steps = signs * rng.uniform(0.7, 1.2, (9, 9, 1, 1, 2)) + rng.normal(0, 0.02, (9, 9, 3, 3, 2))
        unit_steps[:, :, 1, 1] = 0.0
        return JointFault(printer, JointTables((cells[0], cells[1]), unit_steps))
    family = "gain-table" if kind == "increments" else "pulley-play"
    drawn = sample(family, rng, "realistic")
    return MechanismModel(drawn.lower(read_printer("corexy" if kind == "corexy" else "ender5")))


def stays_in_range_and_leads_where_imagined(candidate: ControllerCandidate, kind: str, c_max: int) -> None:
    """Controls are int8 in −c_max…c_max; the imagined path is what the model's `advance` says of them."""
    model = faulty_model(kind)
    plan = candidate.controller.plan(model, TARGETS, START, c_max=c_max)
    need(plan.controls.shape == TARGETS.shape, f"expected controls {TARGETS.shape}, found {plan.controls.shape}")
    need(plan.controls.dtype == np.int8, f"expected int8, found {plan.controls.dtype}")
    need(np.abs(plan.controls).max() <= c_max, f"expected at most {c_max} steps, found {np.abs(plan.controls).max()}")
    shape = (len(TARGETS) + 1, 2)
    need(plan.imagined_steps.shape == shape, f"expected imagined positions {shape}, found {plan.imagined_steps.shape}")
    state = model.start(START)
    for t, control in enumerate(plan.controls[:200]):
        np.testing.assert_allclose(plan.imagined_steps[t], state.position_steps[0], rtol=0, atol=1e-9)
        state = model.advance(state, control[None])


def is_repeatable(candidate: ControllerCandidate, kind: str) -> None:
    """The same question gets the same answer."""
    first, second = (candidate.controller.plan(faulty_model(kind), TARGETS, START) for _ in range(2))
    np.testing.assert_array_equal(first.controls, second.controls)
    np.testing.assert_array_equal(first.imagined_steps, second.imagined_steps)


def leaves_a_healthy_printer_alone(candidate: ControllerCandidate, preset: str) -> None:
    """On a healthy machine the plan is the commands as they were."""
    printer = read_printer(preset)
    for healthy in (NaiveModel(printer), MechanismModel(HEALTHY.lower(printer))):
        plan = candidate.controller.plan(healthy, TARGETS, START)
        np.testing.assert_array_equal(plan.controls, LAYER.controls)
        np.testing.assert_array_equal(plan.imagined_steps, LAYER.nominal_steps)


def prints_what_it_imagines(candidate: ControllerCandidate, family: str, preset: str) -> None:
    """With the true machine as the model, what is imagined is printed."""
    twin = Twin.of(sample(family, np.random.default_rng(11), "realistic"), read_printer(preset))
    targets = TARGETS if family in STRAIGHT else TARGETS[:300]
    plan = candidate.controller.plan(MechanismModel(twin.mechanism), targets, START)
    np.testing.assert_array_equal(plan.imagined_steps, twin.run(plan.controls, START))


def prints_no_worse_than_the_commands(candidate: ControllerCandidate, family: str, preset: str) -> None:
    """With the true machine as the model, the RMSE is at most that of the commands as they were."""
    twin = Twin.of(sample(family, np.random.default_rng(11), "realistic"), read_printer(preset))
    plan = candidate.controller.plan(MechanismModel(twin.mechanism), TARGETS, START)
    error, naive = (
        float(np.sqrt(((twin.run(controls, START)[1:] - TARGETS) ** 2).sum(axis=1).mean()))
        for controls in (plan.controls, LAYER.controls)
    )
    need(error <= naive + 1e-12, f"expected an RMSE of at most {naive:.3f} steps, found {error:.3f}")


def plans_no_targets(candidate: ControllerCandidate, kind: str) -> None:
    """No targets: no controls, and the start as the only imagined position."""
    plan = candidate.controller.plan(faulty_model(kind), np.empty((0, 2)), START)
    need(plan.controls.shape == (0, 2), f"expected controls (0, 2), found {plan.controls.shape}")
    np.testing.assert_array_equal(plan.imagined_steps, [START])


def refuses_bad_input(
    candidate: ControllerCandidate, targets: np.ndarray, start: tuple[float, float], c_max: int
) -> None:
    """What cannot be planned ends in an `InputError`: `printmend_lab.control.check.check_plan` raises it."""
    model = NaiveModel(read_printer("ender5"))
    try:
        candidate.controller.plan(model, targets, np.array(start), c_max=c_max)
    except InputError:
        return
    except Exception as error:
        raise AssertionError(f"expected an InputError, found {type(error).__name__}: {error}") from error
    need(False, "expected an InputError, found a plan")


_BAD = {
    "a start off the bed": (TARGETS, (-1, 5), 3),
    "a start between the lattice's points": (TARGETS, (0.5, 5), 3),
    "targets of one axis": (TARGETS[:, :1], tuple(START.tolist()), 3),
    "targets that are nan": (np.full((3, 2), np.nan), tuple(START.tolist()), 3),
    "controls of no step": (TARGETS, tuple(START.tolist()), 0),
}

CHECKS: dict[str, Callable[[ControllerCandidate], None]] = {
    **{
        f"controls to {c} lead where imagined ({kind})": partial(
            stays_in_range_and_leads_where_imagined, kind=kind, c_max=c
        )
        for kind in KINDS
        for c in (1, 2, 3, 6)
    },
    **{f"is repeatable ({kind})": partial(is_repeatable, kind=kind) for kind in KINDS},
    **{
        f"leaves a healthy {preset} alone": partial(leaves_a_healthy_printer_alone, preset=preset) for preset in PRESETS
    },
    **{
        f"prints what it imagines ({family}, {preset})": partial(prints_what_it_imagines, family=family, preset=preset)
        for family in (*STRAIGHT, "frame", "everything")
        for preset in PRESETS
    },
    **{
        f"prints no worse than the commands ({family}, {preset})": partial(
            prints_no_worse_than_the_commands, family=family, preset=preset
        )
        for family in STRAIGHT
        for preset in PRESETS
    },
    **{f"plans no targets ({kind})": partial(plans_no_targets, kind=kind) for kind in KINDS},
    **{
        f"refuses {what}": partial(refuses_bad_input, targets=targets, start=start, c_max=c_max)
        for what, (targets, start, c_max) in _BAD.items()
    },
}
