"""Tell whether a picture was resized after it was scanned, whatever resolution its file states.

A pixel between two old ones is their mean, with less noise than either has. So the noise of a resized picture rises and
falls as its pixels drift against the old ones, along both sides alike (Gallagher 2005), and so do the blocks of an old
JPEG. A new JPEG has waves of its own, and so has a scan that the scanner enlarged. Those repeat after a whole number
of pixels, and are not counted.
"""

import cv2
import numpy as np
from scipy.ndimage import median_filter

SIDE_PX = 2048  # of the middle of the picture, which is looked at
SMOOTH_PX, APART_PX = 9, 25  # what noise is smoothed over; how far from an edge noise alone is left
QUIET = 2.0  # of the usual unevenness: more is an edge
FEWEST_SHARE, FEWEST = 0.02, 64  # of a column's pixels, and of columns: with fewer quiet ones nothing is told
WAVES = 8192  # waves are looked for at half as many frequencies, up to one wave in two pixels
LOWEST, NEAR = 0.004, 0.003  # waves a pixel: of uneven light; within these two are one
WHOLE_PX = np.arange(2, 9)  # after which a JPEG's blocks, and what was enlarged so many times, repeat
SURE = 15.0  # over the usual power, along both sides: noise alone gets there in one picture of 10^9


def is_resampled(image: np.ndarray) -> bool:
    """Tell whether an image [H, W, 3] was resized, by 0.5 % or more. False without noise, where nobody can tell."""
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    side = min(SIDE_PX, *grey.shape)
    top, left = ((length - side) // 2 for length in grey.shape)
    middle = grey[top : top + side, left : left + side].astype(np.float32)
    quiet = _quiet(middle)
    power = np.minimum(_power(middle, quiet), _power(middle.T, quiet.T))
    waves = np.arange(len(power)) / WAVES
    repeats = waves[:, None] * WHOLE_PX
    away = np.abs(repeats - np.round(repeats)) / WHOLE_PX
    return bool((power[(waves > LOWEST) & (away > NEAR).all(axis=1)] > SURE).any())


def _quiet(grey: np.ndarray) -> np.ndarray:
    """Return which pixels [H, W] of a picture hold noise alone."""
    smooth, near = cv2.blur(grey, (SMOOTH_PX, SMOOTH_PX)), np.ones((SMOOTH_PX, SMOOTH_PX), np.uint8)
    span = cv2.dilate(smooth, near) - cv2.erode(smooth, near)
    edges = (span > QUIET * np.median(span)).astype(np.uint8)
    return np.asarray(cv2.dilate(edges, np.ones((APART_PX, APART_PX), np.uint8)) == 0)


def _power(grey: np.ndarray, quiet: np.ndarray) -> np.ndarray:
    """Return the power of each wave of the noise along the rows, over the usual power near it."""
    noise, count = np.abs(np.diff(grey, 2, axis=1)) * quiet[:, 1:-1], quiet[:, 1:-1].sum(axis=0)
    told = count > FEWEST_SHARE * len(grey)  # not along a printed line
    if told.sum() < FEWEST:
        return np.zeros(WAVES // 2 + 1)
    mean = noise.sum(axis=0) / np.maximum(count, 1)
    mean = np.where(told, mean, np.median(mean[told]))
    mean -= median_filter(mean, round(1 / (2.5 * LOWEST)))
    power = np.abs(np.fft.rfft(mean * np.hanning(len(mean)), WAVES)) ** 2
    usual = median_filter(power, WAVES // 10) / np.log(2)  # an exponential's median is its mean times log 2
    return np.asarray(power / np.maximum(usual, np.finfo(np.float32).tiny))
