"""Convert G-code text to moves and back without loss. Nothing here knows of broken printers.

Import from the modules (`read`, `write`, `machine`, `kernels` …). Nothing is imported here, so that a program
without G-code does not load the compiler.
"""
