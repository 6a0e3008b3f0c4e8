"""The play of a Z screw, followed through a print. Checks happen in screw.py."""

from printmend.jit import entry


@entry
def contacts(centre, half, share, at, side):
    """Fill at [N] with the row where the nut last touched a flank, side [N] with which: −1 pushed up, +1 let down.

    ``centre`` [N] is the height in the middle of the play, ``half`` half the play. At row 0 the nut rests at
    ``share`` of its play, 0 pushed up, 1 let down, and touches nothing: side 0.
    """
    position, at[0], side[0] = centre[0] + (2 * share - 1) * half, 0, 0.0
    for t in range(1, centre.shape[0]):
        at[t], side[t] = at[t - 1], side[t - 1]
        if position < centre[t] - half:
            position, at[t], side[t] = centre[t] - half, t, -1.0
        elif position > centre[t] + half:
            position, at[t], side[t] = centre[t] + half, t, 1.0
