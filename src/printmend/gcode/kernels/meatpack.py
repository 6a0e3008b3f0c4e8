"""MeatPack: two characters in a byte where both are among the fifteen most common of G-code.

A nibble is an index into `0123456789. \\nGX`; 15 says that a whole byte follows. In the mode without spaces the blank's
place is E's. Two 0xFF bytes and a command switch packing and that mode.
"""

import numpy as np

from printmend.gcode.kernels.text import LETTER_E, LF, SEMICOLON, SPACE
from printmend.jit import entry, inner

_TABLE = np.frombuffer(b"0123456789. \nGX", np.uint8)
_INDEX = np.full(256, 15, np.uint8)
_INDEX[_TABLE] = np.arange(15)
_SIGNAL, _PACK, _PLAIN, _RESET, _NO_SPACES, _SPACES = 255, 251, 250, 249, 247, 246  # bytes of the format's commands


@entry(error_model="numpy", _nrt=False)
def unpack(packed, out):
    """Decode ``packed`` into ``out``, which has room for twice its length and two more; return the bytes written."""
    at = 0
    packing, no_spaces = False, False
    # 0xFF bytes seen, whole characters to come, the character after the next one
    signals, waiting, held = 0, 0, np.int64(-1)
    for k in range(len(packed)):
        byte = np.int64(packed[k])
        if signals == 2:
            if byte == _SIGNAL:
                continue
            signals = 0
            if byte == _PACK:
                packing = True
            elif byte in (_PLAIN, _RESET):
                packing = False
            elif byte in (_NO_SPACES, _SPACES):
                no_spaces = byte == _NO_SPACES
            continue
        if byte == _SIGNAL:
            signals += 1
            continue
        for turn in range(signals + 1):  # a lone 0xFF before this byte was data
            value = _SIGNAL if turn < signals else byte
            if not packing or waiting > 0:
                out[at] = value
                at += 1
                if packing:
                    waiting -= 1
                    if held >= 0:
                        out[at] = held
                        at += 1
                        held = np.int64(-1)
                continue
            low, high = value & 15, value >> 4
            first = np.int64(_TABLE[low]) if low < 15 else np.int64(-1)
            second = np.int64(_TABLE[high]) if high < 15 else np.int64(-1)
            if no_spaces and first == SPACE:
                first = np.int64(LETTER_E)
            if no_spaces and second == SPACE:
                second = np.int64(LETTER_E)
            if first < 0:
                waiting = 1 if second >= 0 else 2
                held = second
            else:
                out[at] = first
                at += 1
                if first != LF:  # the other half of a line's last byte is padding
                    if second >= 0:
                        out[at] = second
                        at += 1
                    else:
                        waiting = 1
        signals = 0
    return at


@entry(error_model="numpy", _nrt=False)
def pack(text, no_spaces, out):
    """Encode whole lines into ``out``, which has room for twice the length, 6 a line and 16; return the bytes written.

    Lines of comment are written plainly, between commands that switch packing off and on.
    """
    at = _put_command(out, 0, _PACK)
    if no_spaces:
        at = _put_command(out, at, _NO_SPACES)
    packing = True
    p, end = 0, len(text)
    while p < end:
        stop = p
        while stop < end and text[stop] != LF:
            stop += 1
        stop = min(stop + 1, end)
        if text[p] == SEMICOLON:
            if packing:
                at = _put_command(out, at, _PLAIN)
                packing = False
            for k in range(p, stop):
                out[at] = text[k]
                at += 1
            p = stop
            continue
        if not packing:
            at = _put_command(out, at, _PACK)
            packing = True
        while p < stop:
            first = text[p]
            second = text[p + 1] if p + 1 < stop else np.uint8(LF)
            low, high = _nibble(first, no_spaces), _nibble(second, no_spaces)
            out[at] = low | high << 4
            at += 1
            if low == 15:
                out[at] = first
                at += 1
            if high == 15:
                out[at] = second
                at += 1
            p += 2
        p = stop
    return at


@inner
def _nibble(byte, no_spaces):
    """Return the index of a character in the table, 15 for one that is not there."""
    if no_spaces:
        if byte == SPACE:
            return np.uint8(15)
        if byte == LETTER_E:
            return _INDEX[SPACE]
    return _INDEX[byte]


@inner
def _put_command(out, at, command):
    """Write a command to whoever unpacks."""
    out[at] = out[at + 1] = _SIGNAL
    out[at + 2] = command
    return at + 3
