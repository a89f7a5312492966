"""The common part of all designs in one state: two guides between two junctions, with stems, emitter and receiver.

Strategy: all that does not depend on the cavities is computed once a state, in plain numpy, and rejected here by name
where it cannot be built. The compiled part (`geometry.py`) then only cuts the guides into cells.

A **surface** is one row of 16 numbers, the same for arcs and lines. With q = x - P0, it lies where
f(x) = k/2 |q|^2 - N0.q equals `level`; f falls along the normal N0, by -u + k u^2/2 at offset u. It reaches from end Pa
to end Pb: Ta.(x - Pa) >= 0 and Tb.(x - Pb) < 0, half-open, so that a joint belongs to one surface. The row is P0, N0,
k, level, the sign of f's slope on the way out of the resin, 1 / |grad f|, Pa, Ta, Pb, Tb.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.spatial.distance import cdist

from analysis.optics.scene.arc_spline import ArcSpline
from analysis.optics.scene.parameters import Design, Waveguide
from protocol.base.arrays import FloatArray, IntArray
from protocol.base.errors import DataError, RequestError

NO_SURFACE, INTERFACE, RECEIVER = 0, 1, 2
CORNER_A, CORNER_B, FREE = 1, 2, 4
JUNCTION_START, JUNCTION_END, NO_CELL = -1, -2, -3
_SAMPLES = 1500
_TIGHTEST = 0.98
_MIRRORED, _TWINS = 1e-6, 1e-12


class SceneFrame(NamedTuple):
    """One state without its cavities, as the compiled code and the workers of a cluster use it.

    `nodes`: (g, m + 1, 5) joints of each guide's centreline, as in `ArcSpline`; guide 0 is on the left of the direction
    from emitter to receiver. `free`: (g, m, 2) whether an arc's left and right edge have the whole scene behind each of
    their tangents, so that light leaving there meets nothing more.
    """

    nodes: FloatArray
    curvature: FloatArray  # (g, m), 1/mm
    ends: FloatArray  # (g, 2) arc lengths between which a guide is its own, beyond them it is part of a junction
    outer: FloatArray  # (g,) +1 where the outer face is the left one, -1 where it is the right one
    half_mm: float
    free: IntArray
    surfaces: FloatArray  # (j, 16) of the two junctions with their stems; a single strip has none
    # kinds, owners, corners: (j,) what a surface is, which junction it bounds, which of its ends are corners
    kinds: IntArray
    owners: IntArray
    corners: IntArray
    emitter: FloatArray  # (4,) x, y of the point, unit direction of the fan's middle
    receiver_direction: FloatArray  # (2,) unit vector along which light must arrive to be counted
    source_cell: int  # cell in which the rays start

    @property
    def free_mm(self) -> float:
        """Return the longest centred row of cavities that fits both guides, mm."""
        middle = self.nodes[:, -1, 4] / 2
        return float(2 * np.min(np.minimum(middle - self.ends[:, 0], self.ends[:, 1] - middle)))

    @property
    def asymmetry(self) -> float:
        """Return how far a guide is from the other's mirror image in the middle of the fan, in half thicknesses."""
        if len(self.nodes) != 2:
            return np.inf
        x, y = self.emitter[2:]
        left, right = (self.nodes[..., :2] - self.emitter[:2]) @ np.array([[x, -y], [y, x]])
        return float(np.max(np.abs(left - right * [1.0, -1.0]))) / self.half_mm

    @property
    def mirrored(self) -> bool:
        """Return whether both halves of a fan sample the same function; cavities do not change that."""
        return self.asymmetry <= _MIRRORED

    @property
    def twins(self) -> bool:
        """Return whether each ray has a mirror image but for rounding, so that one of the two need not be followed."""
        return self.asymmetry <= _TWINS

    def guide(self, number: int) -> ArcSpline:
        """Return the centreline of guide 0 or 1."""
        return ArcSpline(self.nodes[number], self.curvature[number])


def line_surface(start: FloatArray, end: FloatArray) -> FloatArray:
    """Return a straight surface from `start` to `end` with the resin on its left, (16,)."""
    tangent = (end - start) / np.hypot(*(end - start))
    normal = np.array([-tangent[1], tangent[0]])
    return np.concatenate([start, normal, [0.0, 0.0, 1.0, 1.0], start, tangent, end, tangent])


def arc_surface(curve: ArcSpline, arc: int, u: float, span: tuple[float, float]) -> FloatArray:
    """Return the offset of one arc as a surface, the resin on the centreline's side, (16,)."""
    (x, y, tx, ty, _), k = curve.nodes[arc], curve.curvature[arc]
    (start, end), (tangent_a, tangent_b) = curve.offset(np.array(span), u), curve.frame(np.array(span))[1]
    circle = [x, y, -ty, tx, k, -u + k * u * u / 2, -np.sign(u), 1 / (1 - k * u)]
    return np.concatenate([circle, start, tangent_a, end, tangent_b])


def offset_of(curve: ArcSpline, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return signed distance u and arc length s of each point's (n, 2) nearest foot; u is inf beyond the ends."""
    (x, y, tx, ty, _), k = curve.nodes.T, curve.curvature
    qx, qy = np.subtract.outer(points[:, 0], x), np.subtract.outer(points[:, 1], y)
    ahead = qx * tx + qy * ty
    inside = (ahead[:, :-1] >= 0) & (ahead[:, 1:] < 0)
    qx, qy = qx[:, :-1], qy[:, :-1]
    left = qy * tx[:-1] - qx * ty[:-1]
    level = k / 2 * (qx**2 + qy**2) - left
    root = np.sqrt(np.maximum(1 + 2 * k * level, 0.0))
    u = np.where(inside, -2 * level / (1 + root), np.inf)
    best = np.argmin(np.abs(u), axis=1)
    row = np.arange(len(points))
    k, a, b = k[best], ahead[row, best], 1 - k[best] * left[row, best]
    with np.errstate(divide="ignore", invalid="ignore"):
        step = np.where(np.abs(k) * np.hypot(a, b) > 1e-14, np.arctan2(k * a, b) / k, a / b)
    return u[row, best], curve.nodes[best, 4] + step


Edges = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
"""Start, tangent there, end, tangent there of several arcs, (n, 2) each."""


def _hull(edges: Edges) -> FloatArray:
    """Return triangles (n, 3, 2) that enclose arcs: both ends and the point where the tangents there meet."""
    a, tangent_a, b, tangent_b = edges
    cross = tangent_a[:, 0] * tangent_b[:, 1] - tangent_a[:, 1] * tangent_b[:, 0]
    chord = b - a
    along = chord[:, 0] * tangent_b[:, 1] - chord[:, 1] * tangent_b[:, 0]
    flat = np.abs(cross) < 1e-9
    step = np.where(flat, 0.5 * np.hypot(*chord.T), along / np.where(flat, 1.0, cross))
    return np.stack([a, a + step[:, None] * tangent_a, b], axis=1)


def free_edges(guides: list[ArcSpline], half: float, junction: FloatArray) -> IntArray:
    """Return (g, m, 2): 1 where the whole scene lies behind the tangents and the chord of an arc's left or right edge.

    Light that leaves there meets nothing more. Cavities only remove resin, so this holds for every design.
    """
    edges = [[_edges(curve, side * half) for side in (1.0, -1.0)] for curve in guides]
    hulls = [_hull(e) for pair in edges for e in pair]
    if len(junction):
        hulls.append(_hull((junction[:, 8:10], junction[:, 10:12], junction[:, 12:14], junction[:, 14:16])))
    points = np.concatenate([hull.reshape(-1, 2) for hull in hulls])
    slack = 1e-10 * float(np.max(np.ptp(points, axis=0)))
    return np.stack(
        [np.stack([_behind(points, e, s, slack) for e, s in zip(pair, (1.0, -1.0), strict=True)], 1) for pair in edges]
    )


def _edges(curve: ArcSpline, u: float) -> Edges:
    """Return each arc's offset."""
    xy = curve.nodes[:, :2] + u * np.stack([-curve.nodes[:, 3], curve.nodes[:, 2]], axis=1)
    return xy[:-1], curve.nodes[:-1, 2:4], xy[1:], curve.nodes[1:, 2:4]


def _behind(points: FloatArray, edges: Edges, side: float, slack: float) -> IntArray:
    """Return whether no point lies on the outer side (left for +1) of the tangents at both ends nor of the chord."""
    a, tangent_a, b, tangent_b = edges
    out = np.ones(len(a), dtype=bool)
    chord = (b - a) / np.hypot(*(b - a).T)[:, None]
    bulge = _hull(edges)[:, 1]
    for start, tangent, own in ((a, tangent_a, 0.0), (b, tangent_b, 0.0), (a, chord, 1.0)):
        q = points[None] - start[:, None]
        above = side * (tangent[:, None, 0] * q[..., 1] - tangent[:, None, 1] * q[..., 0])
        mine = np.hypot(*(points[None] - bulge[:, None]).transpose(2, 0, 1)) == 0.0
        out &= np.all((above <= slack) | (mine & (own > 0)), axis=1)
    return out.astype(np.int32)


def check_bends(curve: ArcSpline, half: float, name: str) -> None:
    """Reject a guide whose edge would fold over in a bend. Raises DataError: the radius is too small."""
    tightest = float(np.max(np.abs(curve.curvature)))
    if tightest * half > _TIGHTEST:
        cause = f"{name} bends to a radius of {1 / tightest:.3g} mm, too tight for a guide {2 * half:g} mm thick"
        raise DataError(cause, "use a thinner guide or a smoother curve")


def two_guides(left: ArcSpline, right: ArcSpline, guide: Waveguide, name: str = "the guides") -> SceneFrame:
    """Join two centrelines that share both ends into stems, junctions and guides."""
    half = guide.thickness_mm / 2
    for number, curve in enumerate((left, right), start=1):
        check_bends(curve, half, f"{name}: guide {number}")
    start = _crotch(left, right, half, name)
    end_left, end_right = _crotch(right.reversed(), left.reversed(), half, name)[::-1]
    ends = np.array([[start[0], left.length - end_left], [start[1], right.length - end_right]])
    _check_apart(left, right, ends, half, name)
    parts = [
        _junction(left, right, ends[:, 0], guide, JUNCTION_START, name),
        _junction(right.reversed(), left.reversed(), np.array([end_right, end_left]), guide, JUNCTION_END, name),
    ]
    *rows, outward = zip(*parts, strict=True)
    surfaces, kinds, corners = map(np.concatenate, rows)
    owners = np.repeat([JUNCTION_START, JUNCTION_END], [len(k) for k in rows[1]])
    emitter = np.concatenate([left.nodes[0, :2] + outward[0] * guide.stem_mm, -outward[0]])
    junctions = surfaces, kinds, owners, corners
    return _frame([left, right], ends, np.array([1.0, -1.0]), half, junctions, (emitter, outward[1], JUNCTION_START))


def _frame(
    guides: list[ArcSpline], ends: FloatArray, outer: FloatArray, half: float, junctions: Any, light: Any
) -> SceneFrame:
    """Return the frame of some guides; `junctions` are the fields of their surfaces, `light` those of the light."""
    nodes, curvature = np.stack([g.nodes for g in guides]), np.stack([g.curvature for g in guides])
    return SceneFrame(nodes, curvature, ends, outer, half, free_edges(guides, half, junctions[0]), *junctions, *light)


def one_strip(curve: ArcSpline, guide: Waveguide, emitter: FloatArray | None = None) -> SceneFrame:
    """Return a single guide with square ends, its end face the receiver: the scene of the closed forms.

    `emitter`: x, y, direction x, y; by default `backing_mm` inside the start, looking along the guide.
    """
    half = guide.thickness_mm / 2
    check_bends(curve, half, "the guide")
    if emitter is None:
        point, tangent = curve.frame(np.array([guide.backing_mm]))
        emitter = np.concatenate([point[0], tangent[0]])
    _, s = offset_of(curve, emitter[None, :2])
    cell = int(np.searchsorted(curve.nodes[:, 4], s[0], side="right") - 1)
    none = np.zeros((0, 16)), *[np.zeros(0, dtype=np.int64)] * 3
    ends, outer = np.array([[0.0, curve.length]]), np.array([1.0])
    return _frame([curve], ends, outer, half, none, (emitter, curve.nodes[-1, 2:4], cell))


def _crotch(left: ArcSpline, right: ArcSpline, half: float, name: str) -> tuple[float, float]:
    """Return the arc lengths on both guides at which their inner edges part, seen from the start."""

    def gap(s: float) -> float:
        u, _ = offset_of(right, left.offset(np.array([s]), -half))
        return float(min(u[0], 1e3 * half) - half)

    s = np.linspace(0.0, left.length, _SAMPLES)
    u, _ = offset_of(right, left.offset(s, -half))
    clear = np.flatnonzero(u > half)
    if not clear.size:
        remedy = f"bow them apart by more than the guide's thickness of {2 * half:g} mm, or use a thinner guide"
        raise DataError(f"{name}: the two guides touch along their whole length", remedy)
    if clear[0] == 0:
        if np.hypot(*(left.nodes[0, :2] - right.nodes[0, :2])) < half:
            raise DataError(f"{name}: the two guides cross", "let each guide stay on its side of the axis")
        cause = f"{name}: the two guides do not meet at their junction"
        raise DataError(cause, "let both curves share their end points")
    s_left = float(brentq(gap, s[clear[0] - 1], s[clear[0]], xtol=1e-14, rtol=1e-15))
    _, s_right = offset_of(right, left.offset(np.array([s_left]), -half))
    return s_left, float(s_right[0])


def _check_apart(left: ArcSpline, right: ArcSpline, ends: FloatArray, half: float, name: str) -> None:
    """Reject guides that touch between their junctions, and guides that cross themselves."""
    margin = 1e-6 * half
    for number, (a, b, u) in enumerate(((left, right, -half), (right, left, half))):
        s = np.linspace(ends[number, 0], ends[number, 1], _SAMPLES)[1:-1]
        away, _ = offset_of(b, a.offset(s, u))
        if ends[number, 0] >= ends[number, 1] or np.any(np.abs(away) < half - margin):
            cause = f"{name}: the two guides touch between their junctions"
            raise DataError(cause, "bow them further apart or use a thinner guide")
        points = a.frame(s)[0]
        near = np.flatnonzero(cdist(points[::8], points, "sqeuclidean") < (2 * half) ** 2)
        i, j = np.divmod(near, len(points))
        if np.any(np.abs(s[::8][i] - s[j]) > 4 * half):
            raise DataError(f"{name}: guide {number + 1} runs into itself", "check the order of its points")


def _junction(
    left: ArcSpline, right: ArcSpline, crotch: FloatArray, guide: Waveguide, end: int, name: str
) -> tuple[FloatArray, IntArray, IntArray, FloatArray]:
    """Return surfaces, kinds and corners of one junction with its stem, and the direction outwards along the stem."""
    half, centre = guide.thickness_mm / 2, left.nodes[0, :2]
    both = left.nodes[0, 2:4] + right.nodes[0, 2:4]
    if np.hypot(*both) < 0.35:
        cause = f"{name}: the guides leave their junction in opposite directions"
        raise DataError(cause, "let them leave it side by side, each within 80 degrees of the stem")
    out = -both / np.hypot(*both)
    across = np.array([out[1], -out[0]])
    far = guide.stem_mm + (guide.backing_mm if end == JUNCTION_START else 0.0)
    rim = [centre + far * out + side * half * across for side in (1.0, -1.0)]
    rows, corners = [], []
    foot = []
    for curve, s_crotch, side in ((left, crotch[0], 1.0), (right, crotch[1], -1.0)):
        s0 = _leaves_stem(curve, s_crotch, half, side, across, name)
        foot.append(curve.offset(np.array([s0]), side * half)[0])
        for arc, span in _pieces(curve, s0, s_crotch):
            rows.append(arc_surface(curve, arc, side * half, span))
            corners.append(CORNER_A if span[0] == s0 else 0)
    face, kinds = _end_face(rim, guide, end)
    lines = [line_surface(foot[0], rim[0]), *face, line_surface(rim[1], foot[1])]
    rows += lines
    corners += [CORNER_A | CORNER_B] * len(lines)
    kind = [INTERFACE] * (len(rows) - len(lines) + 1) + kinds + [INTERFACE]
    return np.array(rows), np.array(kind, dtype=np.int64), np.array(corners, dtype=np.int64), out


def _end_face(rim: list[FloatArray], guide: Waveguide, end: int) -> tuple[list[FloatArray], list[int]]:
    """Return the stem's end from left rim to right rim; at the receiver's end the receiver is its middle."""
    if end == JUNCTION_START or guide.receiver_mm == 0.0:
        return [line_surface(rim[0], rim[1])], [INTERFACE]
    width = guide.thickness_mm if guide.receiver_mm is None else guide.receiver_mm
    middle, along = (rim[0] + rim[1]) / 2, (rim[1] - rim[0]) / guide.thickness_mm
    edge = [middle - width / 2 * along, middle + width / 2 * along]
    if width >= guide.thickness_mm * (1 - 1e-9):
        return [line_surface(*(edge if width > guide.thickness_mm else rim))], [RECEIVER]
    return (
        [line_surface(rim[0], edge[0]), line_surface(edge[0], edge[1]), line_surface(edge[1], rim[1])],
        [INTERFACE, RECEIVER, INTERFACE],
    )


def _leaves_stem(curve: ArcSpline, s_crotch: float, half: float, side: float, across: FloatArray, name: str) -> float:
    """Return the arc length at which a guide's outer edge leaves the stem's edge."""

    def height(s: float) -> float:
        return float((curve.offset(np.array([s]), side * half)[0] - curve.nodes[0, :2]) @ across * side - half)

    s = np.linspace(0.0, s_crotch, 200)
    out = np.flatnonzero((curve.offset(s, side * half) - curve.nodes[0, :2]) @ across * side > half)
    if not out.size:
        cause = f"{name}: the guides leave their junction too steeply curved for its stem"
        raise DataError(cause, "use a thinner guide or a smoother curve at the ends")
    return 0.0 if out[0] == 0 else float(brentq(height, s[out[0] - 1], s[out[0]], xtol=1e-14, rtol=1e-15))


def _pieces(curve: ArcSpline, s0: float, s1: float) -> list[tuple[int, tuple[float, float]]]:
    s = curve.nodes[:, 4]
    return [
        (i, (max(s[i], s0), min(s[i + 1], s1)))
        for i in range(len(curve.curvature))
        if min(s[i + 1], s1) - max(s[i], s0) > 1e-9 * s1
    ]


def check_design(frame: SceneFrame, design: Design, name: str) -> None:
    """Reject cavities that cut through the guide or do not fit between the junctions."""
    thickness = 2 * frame.half_mm
    if design.cavities and design.cut_mm >= thickness * (1 - 1e-6):
        raise RequestError(
            f"a cavity of {design.depth_mm:g} mm depth cuts through the guide of {thickness:g} mm",
            f"choose a depth below {thickness * design.depth_mm / design.cut_mm:g} mm or a thicker guide",
        )
    if design.row_mm >= frame.free_mm:
        raise RequestError(
            f"{name}: a row of cavities {design.row_mm:.4g} mm long does not fit the {frame.free_mm:.4g} mm "
            "between the junctions",
            "choose fewer, narrower or closer cavities",
        )
