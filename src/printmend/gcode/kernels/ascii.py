"""Character codes that the interpreter and the writer of G-code look for and write.

Letters are int64 values, not literals: for literals numba would compile the functions that take them once for each.
"""

import numpy as np

LF, CR, SPACE = 10, 13, 32
QUOTE, HASH, OPEN, CLOSE, STAR, PLUS, MINUS, POINT = 34, 35, 40, 41, 42, 43, 45, 46
ZERO, ONE, THREE, FOUR, FIVE, NINE = 48, 49, 51, 52, 53, 57
COLON, SEMICOLON, EQUALS, BRACKET, BRACKET_END, UNDERSCORE, BRACE, BRACE_END = 58, 59, 61, 91, 93, 95, 123, 125
LETTER_A, LETTER_B, LETTER_C, LETTER_E, LETTER_F = (np.int64(ord(letter)) for letter in "ABCEF")
LETTER_G, LETTER_I, LETTER_L, LETTER_M = (np.int64(ord(letter)) for letter in "GILM")
LETTER_N, LETTER_P, LETTER_S, LETTER_T = (np.int64(ord(letter)) for letter in "NPST")
LETTER_X, LETTER_Y, LETTER_Z = (np.int64(ord(letter)) for letter in "XYZ")
SMALL_A, SMALL_E, SMALL_Z = 97, 101, 122
TO_SMALL = SMALL_A - 65  # from a capital letter to the small one
