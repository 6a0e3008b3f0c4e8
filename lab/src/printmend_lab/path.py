"""What is printed on the lattice: layers of controls, bodies of layers, and what a controller chose."""

from dataclasses import dataclass, field

import numpy as np

from printmend.path import frozen


@dataclass(frozen=True, eq=False)
class Layer:
    """One layer as lattice controls.

    ``start_steps`` [2] int64, ``controls`` [T, 2] int8 in {−1, 0, 1} as sliced, ``extruding`` [T] bool.
    """

    index: int
    z_mm: float
    start_steps: np.ndarray
    controls: np.ndarray
    extruding: np.ndarray

    def __post_init__(self) -> None:
        object.__setattr__(self, "start_steps", frozen(np.asarray(self.start_steps, np.int64)))
        object.__setattr__(self, "controls", frozen(np.asarray(self.controls, np.int8)))
        object.__setattr__(self, "extruding", frozen(np.asarray(self.extruding, bool)))

    @property
    def nominal_steps(self) -> np.ndarray:
        """The nominal positions [T + 1, 2], the start included: the ideal print of this layer."""
        nominal = np.empty((len(self.controls) + 1, 2), np.int64)
        nominal[0] = self.start_steps
        np.cumsum(self.controls, axis=0, dtype=np.int64, out=nominal[1:])
        nominal[1:] += self.start_steps
        return nominal

    @property
    def transitions(self) -> int:
        return len(self.controls)


@dataclass(frozen=True, eq=False)
class Body:
    """A named, ordered set of layers."""

    name: str
    layers: tuple[Layer, ...]

    @property
    def transitions(self) -> int:
        return sum(layer.transitions for layer in self.layers)

    @property
    def training_layer(self) -> Layer:
        """The layer with the most transitions, the first of equals: the paper's test print (§IV-D)."""
        return max(self.layers, key=lambda layer: layer.transitions)


@dataclass(frozen=True, eq=False)
class Plan:
    """What a controller chose: ``controls`` [T, 2] int8 steps and the ``imagined`` positions [T + 1, 2] steps.

    ``planner`` names the controller that a model was left to, where that is another than was asked.
    """

    controls: np.ndarray
    imagined_steps: np.ndarray = field(repr=False)
    planner: str = ""
