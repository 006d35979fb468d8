"""Draws layers as a picture, by casting rays: no graphics card, no window, the same everywhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from lenscal.arrays import BoolArray, FloatArray, IntArray
from lenscal.errors import InputError
from planning.layers import Layer, bounds_of

#: Rays per pixel along x and y.
_RAYS: Final = 2
_FIELD_OF_VIEW_RAD: Final = np.radians(26.0)
#: How many surfaces of a transparent layer a ray goes through at most.
_SURFACES: Final = 8
#: How far behind a surface, in units of the picture's size, a ray goes on.
_STEP: Final = 2e-5
#: Neighbouring rays lie on different faces when their normals differ by more, and on different
#: surfaces when their depths do.
_BEND: Final = np.cos(np.radians(10.0))
_JUMP: Final = 0.01
#: By how much a target, which lies on a face of the part, is drawn nearer to the eye.
_LIFT: Final = 2e-4
#: Faces that look this way are brightest.
_LIGHT: Final = np.array([0.07, -0.10, 0.22])


@dataclass(frozen=True, slots=True, eq=False)
class _Hits:
    """Rays that met a surface: their number, depth, unit normal towards the eye, colour, layer."""

    rays: IntArray
    depth: FloatArray
    normal: FloatArray
    colour: FloatArray
    layer: IntArray


def render(
    layers: Sequence[Layer],
    towards: npt.ArrayLike,
    size_px: tuple[int, int] = (900, 700),
    fit: Sequence[Layer] | None = None,
    up: npt.ArrayLike = (0.0, 0.0, 1.0),
) -> FloatArray:
    """Draw what is visible of layers, seen from afar.

    Parameters
    ----------
    layers
        What to draw; transparent layers show their outer and inner faces.
    towards
        (3,) from the middle of what is shown towards the eye.
    size_px
        Width and height of the picture.
    fit
        What has to fit in; by default all that is visible but workspaces.
    up
        (3,) what points up in the picture.

    Returns
    -------
    FloatArray
        (height, width, 3) red, green and blue, from 0 to 1.

    Raises
    ------
    InputError
        When no layer is visible, or the direction has no length or points up.
    """
    shown = [layer for layer in layers if layer.is_visible and len(layer.faces)]
    if not shown:
        raise InputError("there is nothing to draw: no layer with faces is visible")
    fitted = fit or [layer for layer in shown if layer.role != "workspace"] or shown
    low, high = bounds_of(fitted)
    middle, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2 or 1.0
    origin, directions = _rays(np.asarray(towards, float), np.asarray(up, float), size_px)
    shape = size_px[0] * _RAYS, size_px[1] * _RAYS
    solid = [layer for layer in shown if layer.opacity >= 1]
    every = np.arange(len(directions))
    hits = _Caster(solid, middle, radius, origin).cast(
        origin, directions, every, np.zeros(len(every))
    )
    colour = np.ones((len(directions), 3))
    colour[hits.rays] = hits.colour * np.where(_outlines(hits, *shape), 0.35, 1.0)[:, None]
    limit = np.full(len(directions), np.inf)
    limit[hits.rays] = hits.depth
    glass = [layer for layer in shown if layer.opacity < 1]
    casters = [_Caster([layer], middle, radius, origin) for layer in glass]
    _through_glass(glass, casters, origin, directions, limit, colour, shape)
    picture: FloatArray = (
        colour.reshape(size_px[1], _RAYS, size_px[0], _RAYS, 3).mean(axis=(1, 3)).clip(0, 1)
    )
    return picture


def _rays(
    towards: FloatArray, up: FloatArray, size_px: tuple[int, int]
) -> tuple[FloatArray, FloatArray]:
    """The eye and unit directions of all rays, in units of the picture's size about its middle."""
    length = np.linalg.norm(towards)
    right = np.cross(up, towards)
    if length == 0 or np.linalg.norm(right) <= 1e-9 * length * np.linalg.norm(up):
        raise InputError(
            f"a picture cannot be seen from {towards.tolist()} with {up.tolist()} pointing up; "
            "the two must span a plane"
        )
    back, right = towards / length, right / np.linalg.norm(right)
    above = np.cross(back, right)
    half = np.tan(_FIELD_OF_VIEW_RAD / 2)
    width, height = (side * _RAYS for side in size_px)
    smaller = min(width, height)
    x = (np.arange(width) + 0.5 - width / 2) / (smaller / 2) * half
    y = (height / 2 - np.arange(height) - 0.5) / (smaller / 2) * half
    directions = (x[None, :, None] * right + y[:, None, None] * above - back).reshape(-1, 3)
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    eye = back / np.sin(_FIELD_OF_VIEW_RAD / 2)
    return eye, directions


class _Caster:
    """Layers in the form in which embree wants them."""

    def __init__(
        self, layers: Sequence[Layer], middle: FloatArray, radius: float, eye: FloatArray
    ) -> None:
        self._triangles = np.concatenate(
            [np.zeros((0, 3, 3))]
            + [
                (layer.vertices_mm[layer.faces] - middle) / radius
                + (_LIFT * eye if layer.role == "target" else 0.0)
                for layer in layers
            ]
        )
        self._layer = np.repeat(np.arange(len(layers)), [len(layer.faces) for layer in layers])
        self._rgb = np.array([layer.rgb for layer in layers]).reshape(-1, 3)
        edges = self._triangles[:, 1:] - self._triangles[:, :1]
        normals = np.cross(edges[:, 0], edges[:, 1])
        length = np.linalg.norm(normals, axis=-1, keepdims=True)
        self._normals = normals / np.where(length > 0, length, 1.0)
        self._offsets = np.einsum("fi,fi->f", self._normals, self._triangles[:, 0])
        self._scene = rtcore_scene.EmbreeScene()
        if len(self._triangles):
            TriangleMesh(self._scene, self._triangles.astype(np.float32))

    def cast(
        self, origin: FloatArray, directions: FloatArray, rays: IntArray, gone: FloatArray
    ) -> _Hits:
        """Find the first surface along some rays, from so far on each."""
        if not len(self._triangles):
            return _Hits(rays[:0], gone[:0], np.zeros((0, 3)), np.zeros((0, 3)), rays[:0])
        along = directions[rays]
        starts = (origin + gone[:, None] * along).astype(np.float32)
        face = np.asarray(self._scene.run(starts, along.astype(np.float32)), dtype=np.int64)
        met = np.flatnonzero(face >= 0)
        face, along = face[met], along[met]
        normal = self._normals[face]
        slope = np.einsum("ri,ri->r", normal, along)
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = (self._offsets[face] - normal @ origin) / slope
        # A triangle that is seen edge-on, or has no area, is not seen.
        kept = np.isfinite(depth) & (depth > gone[met])
        normal = np.where(slope[:, None] > 0, -normal, normal)[kept]
        light = 0.70 + normal @ _LIGHT
        layer = self._layer[face[kept]]
        return _Hits(rays[met[kept]], depth[kept], normal, self._rgb[layer] * light[:, None], layer)


def _outlines(hits: _Hits, width: int, height: int) -> BoolArray:
    """(K,) where neighbouring rays met different layers, faces, or depths."""
    depth = np.full(height * width, np.inf, dtype=np.float32)
    normal = np.zeros((height * width, 3), dtype=np.float32)
    layer = np.full(height * width, -1, dtype=np.int16)
    depth[hits.rays], normal[hits.rays], layer[hits.rays] = hits.depth, hits.normal, hits.layer
    edge = np.zeros(height * width, dtype=bool)
    for step, there in ((1, hits.rays - 1), (width, hits.rays - width)):
        inside = (there >= 0) & ((step != 1) | (hits.rays % width > 0))
        here, other = hits.rays[inside], there[inside]
        both = layer[here] == layer[other]
        with np.errstate(invalid="ignore"):
            jump = np.abs(depth[here] - depth[other]) > _JUMP * np.minimum(
                depth[here], depth[other]
            )
        bend = np.einsum("ri,ri->r", normal[here], normal[other]) < _BEND
        edge[here] |= ~both | jump | bend
    return edge[hits.rays]


def _through_glass(
    layers: Sequence[Layer],
    casters: Sequence[_Caster],
    origin: FloatArray,
    directions: FloatArray,
    limit: FloatArray,
    colour: FloatArray,
    shape: tuple[int, int],
) -> None:
    """Blend all transparent surfaces in front of what is opaque, the farthest first."""
    found = []
    for layer, caster in zip(layers, casters, strict=True):
        rays, gone = np.arange(len(directions)), np.zeros(len(directions))
        for _ in range(_SURFACES):
            hits = caster.cast(origin, directions, rays, gone)
            seen = hits.depth < limit[hits.rays]
            if not seen.any():
                break
            edges = _outlines(hits, *shape)[seen]
            shade = hits.colour[seen] * np.where(edges, 0.6, 1.0)[:, None]
            opacity = np.where(edges, max(0.5, layer.opacity), layer.opacity)
            found.append((hits.rays[seen], hits.depth[seen], shade, opacity))
            rays, gone = hits.rays[seen], hits.depth[seen] * (1 + _STEP)
    if not found:
        return
    rays, depth, shade, opacity = (
        np.concatenate([surface[k] for surface in found]) for k in range(4)
    )
    order = np.lexsort((-depth, rays))
    rays, shade, opacity = rays[order], shade[order], opacity[order][:, None]
    first = np.r_[True, rays[1:] != rays[:-1]]
    rank = np.arange(len(rays)) - np.maximum.accumulate(np.where(first, np.arange(len(rays)), 0))
    for k in range(int(rank.max()) + 1):
        at = rank == k
        colour[rays[at]] = (1 - opacity[at]) * colour[rays[at]] + opacity[at] * shade[at]
