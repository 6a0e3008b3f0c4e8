"""Compiled kernels of the clock: moves in, seconds out. They import numpy and other kernels only."""
