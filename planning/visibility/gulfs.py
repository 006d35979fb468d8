"""The convex decomposition of the paper: polygon = hull − gulfs, (2), until all is convex.

A polygon becomes a tree of convex parts that are material and hole in turn. Inside a part of
material are the *equivalent holes* of its gulfs, and its holes; inside a hole is the material
between it and its hull. docs/derivations.md proves that their regions, subtracted in turn, are
exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from lenscal.arrays import BoolArray, FloatArray, IntArray
from planning.visibility.loops import FlatFace, axes_across

#: How far beyond its distance from the origin an equivalent hole goes on, in units of the target's
#: frame. The extent of the frame holds viewpoint, target and all between them, and reaches 1.74.
_BEYOND: Final = 2.0
#: Depth of a gulf, as a share of the polygon's size, that is none.
_SHALLOW: Final = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A polygon of material, or a hole, as a convex hull with parts of the other kind in it.

    Parameters
    ----------
    name
        What it is, such as "material" or "gulf 1".
    is_material
        Whether it hides; a hole lets through.
    outline
        (N, 3) corners of the polygon itself, counter-clockwise seen from the face's normal.
    hull
        (H, 3) corners of its convex hull in the same order.
    beyond
        (H,) which edges of the hull (from a corner to the next) lie beyond all lines of sight.
    inside
        What is to be taken out of the hull.
    """

    name: str
    is_material: bool
    outline: FloatArray
    hull: FloatArray
    beyond: BoolArray
    inside: tuple[Part, ...]


def face_part(face: FlatFace) -> Part:
    """Decompose a face.

    Parameters
    ----------
    face
        A polygon with holes, in a target's frame.

    Returns
    -------
    Part
        Its material; the gulfs and then the holes are inside.
    """
    near = np.zeros(len(face.outline), dtype=bool)
    body = _material("material", face.outline, near, face.normal)
    holes = tuple(
        hole_part(hole, face.normal, f"hole {number}") for number, hole in enumerate(face.holes)
    )
    return Part(body.name, True, body.outline, body.hull, body.beyond, (*body.inside, *holes))


def hole_part(outline: FloatArray, normal: FloatArray, name: str = "hole") -> Part:
    """Decompose a hole.

    Parameters
    ----------
    outline
        (N, 3) corners, counter-clockwise seen from the side that the normal points to.
    normal
        (3,) unit normal of its plane.
    name
        What to call it.

    Returns
    -------
    Part
        The hole; the material between it and its hull is inside.
    """
    return _hole(name, outline, np.zeros(len(outline), dtype=bool), normal)


def _material(name: str, outline: FloatArray, beyond: BoolArray, normal: FloatArray) -> Part:
    hull, chains = _hull_and_chains(outline, normal)
    gulfs = tuple(
        _hole(f"gulf {number}", *_equivalent_hole(outline[chain], normal), normal)
        for number, chain in enumerate(chains)
    )
    return Part(name, True, outline, outline[hull], _edges_beyond(beyond[hull]), gulfs)


def _hole(name: str, outline: FloatArray, beyond: BoolArray, normal: FloatArray) -> Part:
    hull, chains = _hull_and_chains(outline, normal)
    rest = tuple(
        _material(f"rest {number}", outline[chain[::-1]], beyond[chain[::-1]], normal)
        for number, chain in enumerate(chains)
    )
    return Part(name, False, outline, outline[hull], _edges_beyond(beyond[hull]), rest)


def _equivalent_hole(chain: FloatArray, normal: FloatArray) -> tuple[FloatArray, BoolArray]:
    """A gulf and the half-plane beyond its lid, as far as any line of sight goes.

    The gulf lies to the left of the lid, which leads from the first corner of the chain to its
    last; the half-plane lies to the right.
    """
    start, stop = chain[0], chain[-1]
    length = float(np.linalg.norm(stop - start))
    along = (stop - start) / length
    reach = float(np.linalg.norm(start + stop)) / 2 + length + _BEYOND
    middle = (start + stop) / 2
    behind, ahead = middle - reach * along, middle + reach * along
    right = reach * np.cross(along, normal)
    far = np.stack([behind, behind + right, ahead + right, ahead])
    is_far = np.arange(len(chain) + 4) >= len(chain)
    return np.concatenate([chain[::-1], far]), is_far


def _edges_beyond(corners_beyond: BoolArray) -> BoolArray:
    both: BoolArray = corners_beyond & np.roll(corners_beyond, -1)
    return both


def _hull_and_chains(outline: FloatArray, normal: FloatArray) -> tuple[IntArray, list[IntArray]]:
    """Corners of the hull, and the chains of corners within it, their ends on it included."""
    flat = (outline - outline[0]) @ axes_across(normal).T
    tolerance = _SHALLOW * float(np.ptp(flat, axis=0).max())
    hull = _hull_corners(flat, tolerance)
    count = len(flat)
    chains = []
    for here, there in zip(hull, np.roll(hull, -1), strict=True):
        chain = np.arange(here, there + 1 if there > here else there + count + 1) % count
        lid = flat[there] - flat[here]
        arms = flat[chain] - flat[here]
        depth = np.abs(lid[0] * arms[:, 1] - lid[1] * arms[:, 0]) / np.linalg.norm(lid)
        # A chain that comes back to the lid on its way goes around more than one gulf.
        on_lid = np.flatnonzero(depth <= tolerance)
        chains += [chain[a : b + 1] for a, b in pairwise(on_lid.tolist()) if b > a + 1]
    return hull, chains


def _hull_corners(flat: FloatArray, tolerance: float) -> IntArray:
    """Corners of the convex hull in the order of the outline (Andrew's monotone chain)."""
    order = np.lexsort((flat[:, 1], flat[:, 0]))

    def half(indices: IntArray) -> list[int]:
        chain: list[int] = []
        for index in indices.tolist():
            while len(chain) > 1:
                base, arm = flat[index] - flat[chain[-2]], flat[chain[-1]] - flat[chain[-2]]
                turn = arm[0] * base[1] - arm[1] * base[0]
                if turn > tolerance * np.hypot(*base):
                    break
                chain.pop()
            chain.append(index)
        return chain

    return np.unique(half(order) + half(order[::-1]))
