"""Loops over tree ensembles. Arrays and scalars in, arrays out; checks happen in trees.py."""

import numpy as np

from printmend.jit import entry


@entry
def predict(rows, feature, threshold, left, right, value, roots, out):
    """Add the prediction of every tree at rows [N, F] to out [N, O], in the order of the trees."""
    for i in range(rows.shape[0]):
        for tree in range(roots.shape[0]):
            node = roots[tree]
            while feature[node] >= 0:
                node = left[node] if rows[i, feature[node]] <= threshold[node] else right[node]
            for o in range(value.shape[1]):
                out[i, o] += value[node, o]


@entry
def paint(feature, split, left, right, value, roots, first_output, cells):
    """Add every tree to cells [Bx, By, 3, 3, ·], from output column ``first_output`` on, in the order of the trees.

    ``split`` [nodes]: a cell goes left where its index along the node's feature (x, y, sign x, sign y) is below it.
    One column of cells (all y of one x and one pair of signs) meets few leaves of a tree: they are runs of y.
    """
    columns, height = cells.shape[0], cells.shape[1]
    outputs = value.shape[1]
    run = np.empty((height, outputs))
    stack = np.empty((height + 64, 3), np.int64)
    at = np.zeros(4, np.int64)
    for bx in range(columns):
        for sx in range(3):
            for sy in range(3):
                at[0], at[2], at[3] = bx, sx, sy
                run[:] = 0.0
                for tree in range(roots.shape[0]):
                    stack[0, 0], stack[0, 1], stack[0, 2] = roots[tree], 0, height
                    depth = 1
                    while depth > 0:
                        depth -= 1
                        node, low, high = stack[depth, 0], stack[depth, 1], stack[depth, 2]
                        f = feature[node]
                        while f >= 0:
                            s = split[node]
                            if f != 1:
                                node = left[node] if at[f] < s else right[node]
                            elif high <= s:
                                node = left[node]
                            elif low >= s:
                                node = right[node]
                            else:
                                stack[depth, 0], stack[depth, 1], stack[depth, 2] = right[node], s, high
                                depth += 1
                                node = left[node]
                                high = s
                            f = feature[node]
                        for o in range(outputs):
                            leaf = value[node, o]
                            for by in range(low, high):
                                run[by, o] += leaf
                for by in range(height):
                    for o in range(outputs):
                        cells[bx, by, sx, sy, first_output + o] += run[by, o]
