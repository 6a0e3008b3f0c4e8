"""G-code text ↔ moves, lossless. Knows nothing of broken printers.

Import from the files: `read`, `arcs`, `machine`, `kernels`; nothing is imported here, so that a program
that needs no G-code does not pay for the compiler.
"""
