"""The bounding-volume hierarchy (BVH) over a scene's surfaces, by which rays in the air find the next one.

Strategy: surfaces come in the order of the outline, so that neighbours share a box; nodes are numbered in the order of
a depth-first walk, each with the number of the node that follows where its box is missed. Boxes are computed for each
group of surfaces and joined upwards.
"""

from __future__ import annotations

import math

import numpy as np

from analysis.compiled import inside
from protocol.base.arrays import FloatArray, IntArray

LEAF_SURFACES = 3


@inside
def build_bvh(surfaces: FloatArray, order: IntArray, n: int, boxes: FloatArray, nodes: IntArray) -> None:
    """Build a BVH over the surfaces order[:n], neighbours of the outline side by side.

    `boxes`: (2 s + 2, 4) is filled with centre and half size of each node. `nodes`: (2 s + 2, 3), with the node after a
    miss (of the root: the number of all), and the first and last + 1 place in `order` (0 for a node with children).
    """
    stack = np.empty((64, 2), dtype=np.int64)
    stack[0, 0], stack[0, 1] = 0, (n + LEAF_SURFACES - 1) // LEAF_SURFACES
    top, node = 1, 0
    while top > 0:
        top -= 1
        low, high = stack[top, 0], stack[top, 1]
        leaf = high - low == 1
        nodes[node, 0] = node + 2 * (high - low) - 1
        nodes[node, 1] = low * LEAF_SURFACES
        nodes[node, 2] = min(high * LEAF_SURFACES, n) if leaf else 0
        if not leaf:
            middle = (low + high) // 2
            stack[top, 0], stack[top, 1] = middle, high
            stack[top + 1, 0], stack[top + 1, 1] = low, middle
            top += 2
        node += 1
    _compute_boxes(surfaces, order, boxes, nodes)


@inside
def _compute_boxes(surfaces: FloatArray, order: IntArray, boxes: FloatArray, nodes: IntArray) -> None:
    """Compute boxes from the leaves upwards; a node's children come after it in number."""
    count = nodes[0, 0]
    for node in range(count - 1, -1, -1):
        box = boxes[node]
        box[0], box[1], box[2], box[3] = math.inf, math.inf, -math.inf, -math.inf
        for i in range(nodes[node, 1], nodes[node, 2]):
            _enlarge(box, surfaces[order[i]])
        if nodes[node, 2] == 0:
            for side in range(2):
                child = node + 1 if side == 0 else nodes[node + 1, 0]
                box[0], box[1] = min(box[0], boxes[child, 0]), min(box[1], boxes[child, 1])
                box[2], box[3] = max(box[2], boxes[child, 2]), max(box[3], boxes[child, 3])
    for node in range(count):
        box = boxes[node]
        box[0], box[2] = 0.5 * (box[0] + box[2]), 0.5 * (box[2] - box[0])
        box[1], box[3] = 0.5 * (box[1] + box[3]), 0.5 * (box[3] - box[1])


@inside
def _enlarge(box: FloatArray, row: FloatArray) -> None:
    """Enlarge box (x0, y0, x1, y1) by one surface: its two ends and the bulge of its arc."""
    ax, ay, bx, by = row[8], row[9], row[12], row[13]
    half = 0.5 * math.sqrt((bx - ax) ** 2 + (by - ay) ** 2)
    curve = abs(row[4] * row[7]) * half
    bulge = half * curve / (1.0 + math.sqrt(max(1.0 - curve * curve, 0.0))) + 1e-9 * (half + 1.0)
    box[0], box[1] = min(box[0], ax - bulge, bx - bulge), min(box[1], ay - bulge, by - bulge)
    box[2], box[3] = max(box[2], ax + bulge, bx + bulge), max(box[3], ay + bulge, by + bulge)
