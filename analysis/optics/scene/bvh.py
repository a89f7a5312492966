"""The tree of boxes over a scene's surfaces, by which rays in the air find the next one.

Strategy: surfaces stand in the order of the outline, so that neighbours share a box; nodes are numbered in the order of
a walk through the tree, each with the number to go on with where its box is missed. Boxes are made once for
each group of surfaces and joined upwards.
"""

from __future__ import annotations

import math

import numpy as np

from analysis.arrays import FloatArray, IntArray
from analysis.optics.compiled import compiled

LEAF = 3


@compiled
def _grow(box: FloatArray, row: FloatArray) -> None:
    """Widen box (x0, y0, x1, y1) by one surface: its two ends and the bulge of its arc."""
    ax, ay, bx, by = row[8], row[9], row[12], row[13]
    half = 0.5 * math.sqrt((bx - ax) ** 2 + (by - ay) ** 2)
    curve = abs(row[4] * row[7]) * half
    bulge = half * curve / (1.0 + math.sqrt(max(1.0 - curve * curve, 0.0))) + 1e-9 * (half + 1.0)
    box[0], box[1] = min(box[0], ax - bulge, bx - bulge), min(box[1], ay - bulge, by - bulge)
    box[2], box[3] = max(box[2], ax + bulge, bx + bulge), max(box[3], ay + bulge, by + bulge)


@compiled
def plant(surfaces: FloatArray, leaves: IntArray, n: int, boxes: FloatArray, branches: IntArray) -> int:
    """Stand a tree over surfaces leaves[:n]; returns the number of its nodes.

    Parameters
    ----------
    boxes : filled with centre and half size of each node.
    branches : filled with the node after a miss, and the first and last + 1 place in `leaves` (none for a fork).
    """
    stack = np.empty((64, 2), dtype=np.int64)
    stack[0, 0], stack[0, 1] = 0, (n + LEAF - 1) // LEAF
    top, node = 1 if n > 0 else 0, 0
    while top > 0:
        top -= 1
        low, high = stack[top, 0], stack[top, 1]
        single = high - low == 1
        branches[node, 0] = node + 2 * (high - low) - 1
        branches[node, 1] = low * LEAF
        branches[node, 2] = min(high * LEAF, n) if single else 0
        if not single:
            middle = (low + high) // 2
            stack[top, 0], stack[top, 1] = middle, high
            stack[top + 1, 0], stack[top + 1, 1] = low, middle
            top += 2
        node += 1
    _enclose(surfaces, leaves, boxes, branches, node)
    return node


@compiled
def _enclose(surfaces: FloatArray, leaves: IntArray, boxes: FloatArray, branches: IntArray, nodes: int) -> None:
    """Boxes from the leaves upwards; a node's branches come after it in number."""
    for node in range(nodes - 1, -1, -1):
        box = boxes[node]
        box[0], box[1], box[2], box[3] = math.inf, math.inf, -math.inf, -math.inf
        for i in range(branches[node, 1], branches[node, 2]):
            _grow(box, surfaces[leaves[i]])
        if branches[node, 2] == 0:
            for side in range(2):
                child = node + 1 if side == 0 else branches[node + 1, 0]
                box[0], box[1] = min(box[0], boxes[child, 0]), min(box[1], boxes[child, 1])
                box[2], box[3] = max(box[2], boxes[child, 2]), max(box[3], boxes[child, 3])
    for node in range(nodes):
        box = boxes[node]
        box[0], box[2] = 0.5 * (box[0] + box[2]), 0.5 * (box[2] - box[0])
        box[1], box[3] = 0.5 * (box[1] + box[3]), 0.5 * (box[3] - box[1])
