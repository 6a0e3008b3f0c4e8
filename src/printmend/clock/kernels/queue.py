"""The queue of moves: how fast each begins, once it is known what follows, and how long it takes."""

import numpy as np

from printmend.clock.kernels.layout import AHEAD, KLIPPER, LEAST_SPEED_MM_S
from printmend.jit import inner


@inner(error_model="numpy", _nrt=False)
def _seconds(length, accel, begin2, cruise2, end2):
    """Return how long a move takes that speeds up, cruises and slows down; all squared speeds [mm²/s²]."""
    begin, cruise, end = np.sqrt(begin2), np.sqrt(cruise2), np.sqrt(end2)
    changing = (2.0 * cruise2 - begin2 - end2) / (2.0 * accel)
    return (2.0 * cruise - begin - end) / accel + max(length - changing, 0.0) / cruise


@inner(error_model="numpy", _nrt=False)
def _pass_notes(clock, times, to):
    """Write down the time for the notes up to number ``to``."""
    while clock.noted < to:
        if clock.noted < len(times):
            times[clock.noted] = clock.seconds
        clock.noted += 1


@inner(error_model="numpy", _nrt=False)
def _look_back(queue, count):
    """Find how fast each move may begin so that the last one can stop, at the full and at Klipper's smaller braking.

    In the second plan, the soft one, speed forms hills over the path: a move climbs over all of its length, falls over
    all of it, or has a top in it; a top may also lie between a move that climbs and one that falls. ``peak2`` of the
    moves up to a top is the top's; of those that fall it is infinite.
    """
    end2 = soft_end2 = peak2 = 0.0
    falls_after = False
    for i in range(count - 1, -1, -1):
        move = queue[i]
        move.begin2 = min(move.start2, end2 + move.gain2)
        braking2 = soft_end2 + move.soft2  # from which the soft plan brakes over the whole move
        falls = move.soft_start2 >= braking2
        move.soft_begin2 = braking2 if falls else move.soft_start2
        climbs = move.soft_begin2 + move.soft2 <= soft_end2
        if not falls and (falls_after or not climbs):
            peak2 = min(move.speed * move.speed, (move.soft_begin2 + braking2) / 2.0)
        move.peak2 = np.inf if falls else peak2
        end2, soft_end2, falls_after = move.begin2, move.soft_begin2, falls


@inner(error_model="numpy", _nrt=False)
def _run_klipper(clock, queue, count, done, times):
    """Let the first ``done`` of ``count`` moves go by as Klipper's look-ahead plans them.

    It limits the top speed of each hill to that of the soft plan; on its way down no move speeds up again.
    """
    _look_back(queue, count)
    for i in range(done):
        move = queue[i]
        begin2, end2 = move.begin2, queue[i + 1].begin2 if i + 1 < count else 0.0
        if move.peak2 == np.inf:  # it only slows down
            clock.peak2 = cruise2 = min(clock.peak2, begin2)
        else:
            clock.peak2 = move.peak2
            cruise2 = min((begin2 + end2 + move.gain2) / 2.0, min(move.speed * move.speed, move.peak2))
        _pass_notes(clock, times, move.before)
        if cruise2 > 0.0:
            begin2, end2 = min(begin2, cruise2), min(end2, cruise2)
            clock.seconds += _seconds(move.length, move.accel, begin2, cruise2, end2)


@inner(error_model="numpy", _nrt=False)
def _run_blocks(limits, clock, queue, count, done, times):
    """Let the first ``done`` of ``count`` moves go by as a firmware plans them whose queue holds a few blocks.

    When a move begins, what is in the queue is known, and the last of that has to be able to stop.
    """
    stop2 = LEAST_SPEED_MM_S * LEAST_SPEED_MM_S
    for i in range(done):
        move = queue[i]
        last = min(i + limits.blocks, count)
        begin2, end2, braking2 = max(clock.begin2, stop2), np.inf, 0.0
        for j in range(i + 1, last):
            end2 = min(end2, queue[j].corner2 + braking2)
            braking2 += queue[j].gain2
            if braking2 >= end2:
                break
        end2 = min(min(end2, braking2 + stop2), begin2 + move.gain2)
        end2 = max(end2, begin2 - move.gain2)
        cruise2 = max(min(move.speed * move.speed, (begin2 + end2 + move.gain2) / 2.0), max(begin2, end2))
        _pass_notes(clock, times, move.before)
        clock.seconds += _seconds(move.length, move.accel, begin2, cruise2, end2)
        clock.begin2 = end2


@inner(error_model="numpy", _nrt=False)
def run(limits, clock, queue, times, stop):
    """Let moves go by: all of them where the machine must stop after the last, else those that what follows cannot
    change."""
    count = clock.queued
    done = count if stop else count - AHEAD
    if limits.corner == KLIPPER:
        _run_klipper(clock, queue, count, done, times)
    else:
        _run_blocks(limits, clock, queue, count, done, times)
    for i in range(done, count):
        queue[i - done] = queue[i]
    clock.queued = count - done
    if stop:
        clock.begin2, clock.peak2 = 0.0, np.inf
        _pass_notes(clock, times, clock.notes)
