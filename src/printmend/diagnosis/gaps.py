"""What a trace could not tell of a motor, and which print would."""

from printmend.identify.drive import ALL_SEEN
from printmend.identify.drive.select import LEAST_ROWS_EITHER_WAY
from printmend.learn.greybox import GreyboxModel, LearnedDrive


def gaps_of(model: GreyboxModel) -> tuple[str, ...]:
    """Say what a trace could not tell, motor by motor, a sentence each."""
    gaps = [gap for drive in model.drives for gap in drive_gaps(drive)]
    if not any(drive.sight.crosses for drive in model.drives):
        one, two = (drive.name.upper() for drive in model.drives)
        gaps.append(
            f"{one} and {two} moved together only, so a crooked frame looks like wrong scales. "
            "Print the other diagonal, too."
        )
    return tuple(gaps)


def drive_gaps(drive: LearnedDrive) -> list[str]:
    """Say what the trace could not tell of one motor, and what print would."""
    seen, name = drive.sight, drive.name.upper()
    turn = drive.branches.period_mm
    gaps = []
    if seen.angles < ALL_SEEN:
        longer = f"Print at least {turn:.0f} mm along {name}, better two turns ({2 * turn:.0f} mm)."
        spread = f"Its points lie at the same few angles of each turn: space them by no part of {turn:.0f} mm."
        gaps.append(
            f"{name} was seen on {100 * seen.angles:.0f} % of its pulley's turn only; the rest is a guess. "
            f"{longer if seen.turns < 1 else spread}"
        )
    if min(seen.forward, seen.backward) < LEAST_ROWS_EITHER_WAY:
        way = "forwards" if seen.forward > seen.backward else "backwards"
        gaps.append(f"{name} was measured moving {way} only, so its play is unknown. Print it there and back.")
    elif drive.structure.play != "none" and min(seen.lower_angles, seen.upper_angles) < ALL_SEEN <= seen.angles:
        less = "forwards" if seen.lower_angles < seen.upper_angles else "backwards"
        share = 100 * min(seen.lower_angles, seen.upper_angles)
        gaps.append(
            f"{name} moved {less} over {share:.0f} % of its pulley's turn only; a loose belt may differ on the rest. "
            f"Print a whole turn ({turn:.0f} mm) in each direction."
        )
    return gaps
