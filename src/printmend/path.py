"""Measured traces.

The six words used everywhere: *target* (wanted), *control* (steps commanded in one tick), *nominal* (where a
healthy printer would be), *imagined* (where a model says it is), *printed* (where the twin or the machine put
it), *measured* (what a scan or a table says).
"""

from dataclasses import dataclass, replace

import numpy as np


def frozen(array: np.ndarray) -> np.ndarray:
    """Return a C-contiguous array that cannot be written to."""
    array = np.ascontiguousarray(array)
    if array.flags.writeable:
        array = array.copy()
        array.setflags(write=False)
    return array


def last_way(places: np.ndarray) -> np.ndarray:
    """Return the direction [N, …] in which each axis last moved at each of its places [N, …]: +1, −1, 0 before the
    first move."""
    way = np.sign(np.diff(places, axis=0, prepend=places[:1]))
    rows = np.arange(len(way)).reshape(-1, *(1 for _ in way.shape[1:]))
    return np.take_along_axis(way, np.maximum.accumulate(np.where(way != 0, rows, 0), axis=0), axis=0)


@dataclass(frozen=True)
class Instrument:
    """The errors that all points of a measurement share, and that no fit can see, as standard deviations.

    ``scale_sd`` of its scale, ``axes_sd`` of half the difference between the scales of x and y (shares), ``lean_sd``
    [rad] of half the angle by which these lean, ``wave_mm`` of a slow unevenness, ``carriage_mm`` of a wave that a
    scanner's carriage may make along one axis, ``lens_mm`` of what its lens does 100 mm from the middle (by the square
    and by the cube of the place along its sensor), ``resized_sd`` of the scale of a picture whose stated resolution is
    wrong, or of a sheet that was fitted to its page (a share), ``paper_sd`` by how much paper that holds the print may
    have grown across its grain since (a share). All are 0 for an exact instrument. Once one length is known, the first
    three are correlated: ``scale_axes``, ``scale_lean`` and ``axes_lean`` are their correlations. ``turn_x_rad`` and
    ``turn_y_rad`` are by how much pictures lay turned whose carriage moved along x and y of the bed.
    """

    scale_sd: float = 0.0
    axes_sd: float = 0.0
    lean_sd: float = 0.0
    wave_mm: float = 0.0
    carriage_mm: float = 0.0
    lens_mm: float = 0.0
    resized_sd: float = 0.0
    paper_sd: float = 0.0
    scale_axes: float = 0.0
    scale_lean: float = 0.0
    axes_lean: float = 0.0
    turn_x_rad: float = 0.0
    turn_y_rad: float = 0.0

    @property
    def ways(self) -> np.ndarray:
        """The directions on the bed [2, 2] in which a carriage moved, the first along x, the second along y."""
        x, y = self.turn_x_rad, self.turn_y_rad
        return np.array([[np.cos(x), np.sin(x)], [-np.sin(y), np.cos(y)]])

    @property
    def covariance(self) -> np.ndarray:
        """The covariance [3, 3] of scale, axes and lean."""
        sds = np.array([self.scale_sd, self.axes_sd, self.lean_sd])
        together = np.eye(3)
        for (i, j), value in zip(
            ((0, 1), (0, 2), (1, 2)), (self.scale_axes, self.scale_lean, self.axes_lean), strict=True
        ):
            together[i, j] = together[j, i] = value
        return together * np.outer(sds, sds)

    def known(self, scale_sd: float) -> "Instrument":
        """Return this instrument with a known error of lengths; the errors of its axes and lean scale with it."""
        share = scale_sd / self.scale_sd
        axes_sd, lean_sd = share * self.axes_sd, share * self.lean_sd
        return replace(self, scale_sd=scale_sd, axes_sd=axes_sd, lean_sd=lean_sd, resized_sd=0.0)

    @property
    def is_exact(self) -> bool:
        return self == Instrument()

    @property
    def is_settled(self) -> bool:
        """Tell whether two turns of a plate have shown its axes: its carriage makes no larger waves than are left."""
        return self.carriage_mm <= self.wave_mm


# of an `Instrument`, none below 0
DOUBTS = ("scale_sd", "axes_sd", "lean_sd", "wave_mm", "carriage_mm", "lens_mm", "resized_sd", "paper_sd")

# Flatbeds state their resolution to one or two parts in a thousand, their two axes by themselves, and their carriages
# run uneven by micrometres, some in waves of ten times that, 30 µm (physics.md §4). Their lenses distort by
# tenths of a millimetre over a page (effects/priors.toml).
FLATBED = Instrument(scale_sd=0.0013, axes_sd=0.001, lean_sd=0.0005, wave_mm=0.002, carriage_mm=0.015, lens_mm=0.3)
# The same where the file does not state its resolution, or the picture was resized since: a scale to one digit.
RESIZED = replace(FLATBED, resized_sd=0.04)
# The same where it is not known how the plate lay on the glass: at 45° axes that differ look as if they leaned.
FLATBED_ANY_TURN = replace(FLATBED, axes_sd=0.0008, lean_sd=0.0008)

PAPER_SD = 0.0012  # ``paper_sd`` of a sheet that dried on a warm bed (effects/priors.toml)
LENS_MM = 100.0  # distance from the middle of a sensor line for which ``lens_mm`` holds


def distorted(off_mm: np.ndarray, axis: int) -> np.ndarray:
    """Return how a scanner's sensor line along an axis of the picture shifts places [N, 2], counted from its middle, as
    [N, 2, 3] mm: along it by the square and the cube of the place on it, and across it by the square."""
    along = off_mm[:, axis] / LENS_MM
    out = np.zeros((len(off_mm), 2, 3))
    out[:, axis, 0] = out[:, 1 - axis, 2] = along**2
    out[:, axis, 1] = along**3
    return out


@dataclass(frozen=True)
class Origin:
    """Whose print was measured: the ``printer``'s name and ``kinematics``, and which ``probe`` it was, as 8 hexadecimal
    digits over its plan; empty for a print that is no probe."""

    printer: str
    kinematics: str = ""
    probe: str = ""


@dataclass(frozen=True)
class Motion:
    """How far a moving head strays across its line: ``square_mm2`` is the mean square that lines printed at the speed
    of parts show beyond their own outline's wobble, ``sd_mm2`` its standard deviation. It may be below 0 by chance."""

    square_mm2: float
    sd_mm2: float


@dataclass(frozen=True, eq=False)
class Trace:
    """Commanded way-points and where they were measured, in the order of motion.

    ``commanded_mm`` [N, 2]; between two rows the commanded motion is straight. ``measured_mm`` [N, 2], NaN where
    nothing was measured. ``sigma_mm`` [N] is the standard deviation of each measured coordinate, NaN where unknown.
    ``z_mm`` [N], the commanded height, ``z_measured_mm`` [N] and ``layer`` [N] are optional. ``homed`` says that row 0
    is the home position, reached from the home side, so the engaged side of the belt is known there. ``placed`` says
    that measured positions are the bed's own; those of a scan have an origin of their own. ``instrument`` has the
    errors that all points share; None stands for an exact instrument or, for a scan, for a flatbed. A wall shows one
    direction only: ``normal`` [N, 2] points out of the plastic and ``offset_mm`` [N] is how far along it the wall is
    from its commanded position, both NaN where a row has none. An offset that all walls share is not an error of the
    machine: beads are wider than set, or the first layer is squashed. ``origin`` is None where unknown. The expected
    shrinkage of a part is subtracted: ``shrunk``, a share, about the middle of the bed. ``shrinkage_sd`` is the
    standard deviation of the rest along either axis, a share. ``motion`` is the result of lines printed at speed.
    ``blank_rows`` counts empty rows between others in a table; they are not among the N. ``step_mm`` is the step to
    which measured positions were rounded, 0 if it is too small to show. ``taken`` is the digest of the measurement from
    which this one was made, None for an original.
    """

    commanded_mm: np.ndarray
    measured_mm: np.ndarray
    sigma_mm: np.ndarray | None = None
    z_mm: np.ndarray | None = None
    layer: np.ndarray | None = None
    homed: bool = False
    z_measured_mm: np.ndarray | None = None
    placed: bool = True
    instrument: Instrument | None = None
    normal: np.ndarray | None = None
    offset_mm: np.ndarray | None = None
    origin: Origin | None = None
    blank_rows: int = 0
    shrinkage_sd: float | None = None
    shrunk: float = 0.0
    motion: Motion | None = None
    taken: str | None = None
    step_mm: float = 0.0

    def __post_init__(self) -> None:
        """Freeze the arrays. Raises `ValueError` for one that does not fit the others."""
        count = len(self.commanded_mm)
        for name, shape, dtype in (
            ("commanded_mm", (count, 2), float),
            ("measured_mm", (count, 2), float),
            ("sigma_mm", (count,), float),
            ("z_mm", (count,), float),
            ("z_measured_mm", (count,), float),
            ("layer", (count,), np.int64),
            ("normal", (count, 2), float),
            ("offset_mm", (count,), float),
        ):
            if (value := getattr(self, name)) is None:
                continue
            array = np.asarray(value, dtype)
            if array.shape != shape:
                raise ValueError(f"{name} of a trace: expected the shape {shape}, found {array.shape}")
            object.__setattr__(self, name, frozen(array))

    def __len__(self) -> int:
        return len(self.commanded_mm)

    @property
    def instrument_doubt(self) -> Instrument:
        """The uncertainty of the instrument."""
        return self.instrument or (Instrument() if self.placed else FLATBED_ANY_TURN)

    @property
    def rounding_mm(self) -> float:
        """The standard deviation that rounding to a step makes: that of an even chance over it."""
        return self.step_mm / 12**0.5

    @property
    def measured_rows(self) -> np.ndarray:
        """A mask [N] of the rows with both coordinates measured."""
        return np.isfinite(self.measured_mm).all(axis=1)

    @property
    def wall_rows(self) -> np.ndarray:
        """A mask [N] of the rows of which one direction was measured."""
        if self.normal is None or self.offset_mm is None:
            return np.zeros(len(self), bool)
        return np.isfinite(self.normal).all(axis=1) & np.isfinite(self.offset_mm)
