"""The API's requests and responses, checked and documented in one place; the OpenAPI file is made from these."""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from printmend.studio.offered import MOST_DENT_MM, MOST_PLAY_MM, MOST_SCREW_MM, MOST_SKEW_DEG, Shape

KEY = r"^[0-9a-f]{16}$"
MESSAGES: dict[str, Any] = Field(default_factory=dict, description="ids and values of texts here, by their English")


class Strict(BaseModel):
    """A table with no other keys than these."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class Problem(BaseModel):
    """Why something failed: what was expected, what was found, what to do, in one line."""

    error: str


class Health(BaseModel):
    """That the studio is there, and what it can do."""

    version: str
    waiting: int = Field(description="jobs that have not ended")
    most_bytes: int = Field(description="of an upload")
    shared: bool = Field(default=False, description="devices may be let in here")


class PairCode(BaseModel):
    """A code for a host, good once and for some minutes."""

    code: str
    minutes: int
    address: str  # the studio's address for the host


_NAME = r"^[^/\\\x00-\x1f]*[^./\\\x00-\x1f][^/\\\x00-\x1f]*$"  # can be part of an address: not only dots


class PairIn(Strict):
    """A code that a host was given, and the host's name."""

    code: str = Field(pattern=r"^[0-9]{6}$")
    name: str = Field(min_length=1, max_length=60, pattern=_NAME)


class Paired(BaseModel):
    """What a host keeps: the token for its printer's model."""

    token: str
    printer: str


class PairedHost(BaseModel):
    """A host that gets a printer's model."""

    name: str
    created_s: float


class DeviceCard(BaseModel):
    """A device that may enter."""

    name: str
    user: str = Field(description="whose printers it sees; all of them where this is empty")
    created_s: float


class NewDevice(Strict):
    """A device to be let in."""

    name: str = Field(min_length=1, max_length=60)
    user: str = Field(default="", max_length=60, description="whose printers it sees; all of them where this is empty")


class Welcome(BaseModel):
    """A new device's way in, which is shown once."""

    name: str
    address: str
    qr: str = Field(description="the address as a QR code, a picture as data URI")


class StoragePart(BaseModel):
    """A kind of data that may be removed: mended files and pictures, simulated prints, measurements, unused uploads."""

    part: Literal["mended", "play", "measured", "unused"]
    count: int
    bytes: int
    shown: list[str] = Field(default_factory=list, description="addresses of small pictures of the newest")


class Storage(BaseModel):
    """What a studio keeps on the disk."""

    parts: list[StoragePart]
    kept_bytes: int = Field(description="printers, models, history and files of jobs that go on: they stay")
    free_bytes: int = Field(description="of the disk")
    most_bytes: int = Field(description="that the studio may hold")


class Preset(BaseModel):
    """A printer that the program knows."""

    id: str
    name: str
    kinematics: Literal["cartesian", "corexy"]
    bed_mm: list[float] = Field(description="x from, y from, x to, y to")


class Upload(BaseModel):
    """A file that was sent."""

    id: str
    name: str
    bytes: int


class NewPrinter(Strict):
    """A printer like a preset, or as an uploaded printer.cfg, slicer profile or TOML describes it."""

    name: str = Field(default="", max_length=80)
    preset: str | None = Field(default=None, max_length=80, description="the preset, or whose motors a profile gets")
    upload: str | None = Field(default=None, pattern=KEY, description="an uploaded description")
    bed_mm: list[float] | None = Field(
        default=None, min_length=2, max_length=2, description="width and depth, where they differ from the preset's"
    )


class Renamed(Strict):
    """A printer's new name."""

    name: str = Field(min_length=1, max_length=80)


class HostIn(Strict):
    """Where a printer's OctoPrint or Moonraker is, and the key that it wants."""

    address: str = Field(min_length=1, max_length=300, description="as the browser shows it: http://octopi.local")
    key: str = Field(
        default="", max_length=300, pattern=r"^[\x21-\x7e ]*$", description="API key; Moonraker may want none"
    )


class HostCard(BaseModel):
    """The program that a printer prints with."""

    address: str
    kind: Literal["octoprint", "moonraker"]


class SendIn(Strict):
    """What to send to a printer: the test print, the tower where ``name`` is tower.gcode, or a file of a ``job``."""

    job: str | None = Field(default=None, pattern=KEY)
    name: str = Field(default="", max_length=200)


class PrinterCard(BaseModel):
    """A printer of one's own, and how it is."""

    id: str
    name: str
    kinematics: Literal["cartesian", "corexy"]
    bed_mm: list[float]
    notes: list[str] = Field(default_factory=list, description="what could not be taken over from a description")
    health: str | None = Field(description="what was found, in one line; none before a measurement")
    healthy: bool | None
    measured_s: float | None = Field(description="when it was last measured, in seconds since 1970")
    trend: list[float] = Field(description="how far test prints were off, mm, the oldest first")
    parts: list[str] = Field(default_factory=list, description="of the machine that have a fault")
    has_probe: bool
    digest: str | None = Field(description="of its model")
    host: HostCard | None = Field(description="what it prints with, where that is known here")
    filaments: list[str] = Field(default_factory=list, description="whose shrinkage is known, as pla-black")
    messages: dict[str, Any] = MESSAGES


class JobCard(BaseModel):
    """A job: its kind, its progress, and its result."""

    id: str
    kind: str
    printer: str | None
    params: dict[str, Any]
    state: Literal["queued", "running", "done", "failed", "cancelled"]
    share: float = Field(description="done, 0 to 1")
    step: str = Field(description="what it is doing, a word")
    left_s: float | None = Field(description="seconds that it may still take")
    files: list[str] = Field(default_factory=list, description="may be fetched, some of them before it ends")
    ahead: int = Field(default=0, description="jobs that wait before it")
    error: str | None
    may_force: bool = Field(default=False, description="the file was not mended, and would be with `force`")
    result: dict[str, Any] | None
    created_s: float
    ended_s: float | None


class SideIn(Strict):
    """One motor's pulley and belt on the play screen."""

    shape: Shape = "round"
    dent_mm: float = Field(default=0.0, ge=0, le=MOST_DENT_MM)
    angle_deg: float = Field(default=0.0, ge=0, le=360)
    play_mm: float = Field(default=0.0, ge=0, le=MOST_PLAY_MM)


class EffectIn(Strict):
    """An effect by its name, at a motor or axis, with its numbers by key; see `GET /play/effects`."""

    name: str = Field(max_length=60)
    on: Literal["x", "y"] | None = None
    values: dict[Annotated[str, Field(max_length=40)], float | Literal["x", "y"]] = Field(
        default_factory=dict, max_length=40
    )


class SliderCard(BaseModel):
    """A number of an effect: a slider from ``low`` to ``high``, or one of its ``choices``."""

    key: str
    label: str
    unit: str
    choices: list[int | str]
    value: float | str
    low: float | None = None
    high: float | None = None
    step: float | None = None


class EffectCard(BaseModel):
    """An effect that a printer on the play screen may have."""

    name: str
    title: str
    of: str = Field(description="whose it is: the machine's, one print's, the measurement's or the filament's")
    possible: bool = Field(description="the printer of the play screen can have it")
    on: list[str] = Field(description="the axes at which it can be; empty where it is of all")
    sliders: list[SliderCard]


class EffectList(BaseModel):
    """All effects, those of other packages among them, with the ids of their texts."""

    effects: list[EffectCard]
    messages: dict[str, Any] = Field(default_factory=dict)


class FaultsIn(Strict):
    """What is broken on the printer of the play screen."""

    x: SideIn = Field(default_factory=SideIn)
    y: SideIn = Field(default_factory=SideIn)
    skew_deg: float = Field(default=0.0, ge=-MOST_SKEW_DEG, le=MOST_SKEW_DEG)
    screw_mm: float = Field(default=0.0, ge=0, le=MOST_SCREW_MM, description="how far a bent Z screw pushes layers")
    effects: list[EffectIn] = Field(default_factory=list, max_length=12)


class Preview(BaseModel):
    """Pulleys and test print of a printer that is broken like this."""

    outlines_mm: list[list[list[float]]]
    radii_mm: list[float]
    bed_mm: list[float]
    marks_mm: list[list[float]]
    errors_mm: list[list[float]]
    rms_mm: float = Field(description="of the marks, laid where they fit best")
    part_rms_mm: float = Field(description="of a layer of the part, laid where it fits best, from its wanted path")
    big: list[bool]
    part_mm: list[list[float]]
    printed_mm: list[list[float]]
    joined: list[bool]
    wall_mm: list[list[float]] = Field(description="height of each layer, and how far it is pushed along x")


class MendIn(Strict):
    """An uploaded G-code file to be mended for a printer."""

    upload: str = Field(pattern=KEY)
    force: bool = Field(default=False, description="also where it seems to be for another printer, or not to help")
    scene: bool = Field(default=True, description="also make the three-dimensional picture")
    filament: str | None = Field(default=None, max_length=40, description="also mend what the part will shrink in it")


class ProbeIn(Strict):
    """Which test print to write."""

    size_mm: float | None = Field(default=None, ge=30, le=1000, description="side of its square; else the bed's")
    overwrite: bool = Field(default=False, description="also where another test print's plan is there")


class ProbeCard(BaseModel):
    """A printer's test print, and what it costs."""

    marks: int
    minutes: float
    grams: float
    expected_mm: float = Field(description="the error that will be left anywhere on the bed, root mean square")
    marks_mm: list[list[float]]
    big: list[bool]
    bed_mm: list[float]


class TowerCard(BaseModel):
    """A tower that shows the Z screw, and what it costs."""

    minutes: float
    grams: float
    height_mm: float


class NextCard(BaseModel):
    """The cheapest next print: the smallest square that shows what the measurement could not tell."""

    size_mm: float
    marks: int
    minutes: float
    grams: float
    expected_mm: float = Field(description="the error that it leaves anywhere on the bed, root mean square")


class ScansIn(Strict):
    """Uploaded scans or photos of one printed test print."""

    uploads: list[Annotated[str, Field(pattern=KEY)]] = Field(min_length=1, max_length=8)
    dpi: float | None = Field(default=None, ge=50, le=9600, description="where the files do not say it")
    distance_mm: float | None = Field(default=None, ge=1, le=1000, description="between the two dots that were named")


class VerifyIn(ScansIn):
    """Uploaded scans or photos of a mended check print: of the test print, or one of a part's underside."""

    part: str | None = Field(default=None, pattern=KEY, description="the part's file as it was before mending")
    filament: str | None = Field(default=None, max_length=40, description="what it was printed in, as pla-black")


class FitIn(Strict):
    """Scans of a part's underside and, where there is one, of its top, and the file that was printed."""

    upload: str = Field(pattern=KEY, description="the G-code file")
    uploads: list[Annotated[str, Field(pattern=KEY)]] = Field(min_length=1, max_length=2, description="the scans")
    dpi: float | None = Field(default=None, ge=50, le=9600, description="where the files do not say it")
    distances_mm: list[Annotated[float, Field(ge=1, le=1000)]] = Field(
        default_factory=list, max_length=2, description="what callipers say of the widths that were named"
    )
    filament: str | None = Field(default=None, max_length=40, description="what it was printed in, as pla-black")


class LearnIn(Strict):
    """A measurement to learn from: a job that measured, or an uploaded table."""

    measurement: str | None = Field(
        default=None, pattern=KEY, description="the job that found the marks, or that said whether a part fits"
    )
    exclude: list[Annotated[int, Field(ge=0, le=100_000)]] = Field(
        default_factory=list, max_length=100_000, description="numbers of marks to leave out"
    )
    upload: str | None = Field(default=None, pattern=KEY, description="a trace.csv")
    filament: str | None = Field(
        default=None, max_length=40, description="of an uploaded table: what the part was printed in"
    )


class Distance(BaseModel):
    """A distance to take with callipers: outer edge to outer edge of two large dots."""

    first_mm: list[float]
    second_mm: list[float]
    about_mm: float


class ReadingsIn(Strict):
    """What the callipers said, in the order of the list; null where nothing was taken."""

    readings_mm: list[Annotated[float, Field(gt=0, lt=2000)] | None] = Field(min_length=1, max_length=12)


class Known(BaseModel):
    """What is known of a printer: its faults in words and pictures, its history."""

    said: dict[str, Any] | None
    history: list[dict[str, Any]] = Field(description="measurements and check prints, the oldest first")
    messages: dict[str, Any] = MESSAGES
