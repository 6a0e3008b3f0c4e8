"""What a trace could not tell of a motor, and which print would."""

from printmend.identify.drive import ALL_SEEN
from printmend.identify.drive.select import LEAST_ROWS_EITHER_WAY
from printmend.learn.greybox import GreyboxModel, LearnedDrive
from printmend.messages import say


def gaps_of(model: GreyboxModel) -> tuple[str, ...]:
    """Say what a trace could not tell, motor by motor, a sentence each."""
    gaps = [gap for drive in model.drives for gap in drive_gaps(drive)]
    if not any(drive.sight.crosses for drive in model.drives):
        one, two = (drive.name.upper() for drive in model.drives)
        gaps.append(say("moved-together-only-so-crooked-frame", one, two))
    return tuple(gaps)


def drive_gaps(drive: LearnedDrive) -> list[str]:
    """Say what the trace could not tell of one motor, and what print would."""
    seen, name = drive.sight, drive.name.upper()
    turn = drive.branches.period_mm
    gaps: list[str] = []
    if seen.angles < ALL_SEEN:
        longer = say("print-least-mm-along-better-two", f"{turn:.0f}", name, f"{2 * turn:.0f}")
        spread = say("points-lie-same-few-angles-each", f"{turn:.0f}")
        gaps.append(
            say("seen-over-part-of-turn", name, f"{100 * seen.angles:.0f}", longer if seen.turns < 1 else spread)
        )
    if min(seen.forward, seen.backward) < LEAST_ROWS_EITHER_WAY:
        way = say("forwards" if seen.forward > seen.backward else "backwards")
        gaps.append(say("measured-moving-only-so-play-unknown", name, way))
    elif drive.structure.play != "none" and min(seen.lower_angles, seen.upper_angles) < ALL_SEEN <= seen.angles:
        less = say("forwards" if seen.lower_angles < seen.upper_angles else "backwards")
        share = 100 * min(seen.lower_angles, seen.upper_angles)
        gaps.append(say("moved-over-pulley-s-turn-only", name, less, f"{share:.0f}", f"{turn:.0f}"))
    return gaps
