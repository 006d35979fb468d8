"""Clearance: lens and camera keep away from everything in the scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from lenscal.arrays import BoolArray, FloatArray, IntArray, positive
from lenscal.errors import InputError, PlanningError
from lenscal.sensor import Sensor
from planning.camera_body import CameraBody, Piece
from planning.requirements.margin import Margin, margin_over
from planning.scene import Scene
from planning.separation import directions_apart, separation_mm
from planning.views import Views

#: Pairs of viewpoint and triangle that are looked at at once, so that they stay in the cache, and
#: views that are measured at once, so that the few slow ones do not cost a round each.
_LOOKED_AT: Final = 100_000
_MEASURED: Final = 400_000


@dataclass(frozen=True, slots=True, eq=False)
class Clearance:
    """Every part of lens and camera stays so far from the scene.

    Parameters
    ----------
    body
        Lens and camera, in the frame of the reference camera. The nodal offset of each lens state
        says where that is: the projection centre moves through the body.
    distance_mm
        How far the body must stay away, in mm: the safety distance of the robot.

    Raises
    ------
    InputError
        When the distance is not positive.
    """

    body: CameraBody
    distance_mm: float

    def __post_init__(self) -> None:
        positive("distance_mm", self.distance_mm, "mm")

    @property
    def name(self) -> str:
        """``clearance``."""
        return "clearance"

    @property
    def judges_all_at_once(self) -> bool:
        """True: the few views that come near to something are worked on together."""
        return True

    def margin(self, views: Views) -> Margin:
        """Judge views.

        Parameters
        ----------
        views
            V × S views.

        Returns
        -------
        Margin
            (V, S) by how many mm the distance from body to scene exceeds what is asked; the share
            is of that. It says no more than a share of 1, twice the distance. Where they overlap
            the distance is negative: how far the body had to move off a surface, along its normal
            or along or across the body; inside of material, at least by what it is from the
            surface.

        Raises
        ------
        InputError
            When the subject has no scene.
        PlanningError
            When the projection centre is not known in the frame of the reference camera.
        """
        scene, centres = views.subject.scene, views.states.projection_centre_mm
        if scene is None:
            raise InputError(
                "clearance needs the scene that the lens must not touch; give "
                "Subject(..., scene=...)"
            )
        if centres is None:
            raise PlanningError(
                "clearance needs to know where the projection centre lies in the lens, but this "
                "map has no nodal offsets, since no robot poses were recorded; record a session "
                "with a positioner"
            )
        found = _distances(views, self.body, scene, centres, 2 * self.distance_mm)
        spare = np.minimum(found - self.distance_mm, self.distance_mm)
        return margin_over(
            views, spare, "mm", spare / self.distance_mm, self.describe(views.states.sensor)
        )

    def describe(self, sensor: Sensor) -> str:  # noqa: ARG002
        """Say what is asked.

        Parameters
        ----------
        sensor
            The sensor.

        Returns
        -------
        str
            Such as "clearance of 10 mm between the lens and the scene".
        """
        return f"clearance of {self.distance_mm:g} mm between the lens and the scene"


def _distances(
    views: Views, body: CameraBody, scene: Scene, centres: FloatArray, enough_mm: float
) -> FloatArray:
    """(S, V) signed distance of body and scene in mm, as far as it is less than what is enough."""
    viewpoints, states = views.shape
    found = np.full((states, viewpoints), np.inf)
    triangles = scene.triangles_mm
    step = max(1, _MEASURED // states)
    for piece in body.pieces:
        for start in range(0, viewpoints, step):
            part = slice(start, start + step)
            found[:, part] = np.minimum(
                found[:, part],
                _piece_distances(views.some(part), piece, triangles, centres, enough_mm),
            )
        _mark_inside(views, piece, scene, centres, found)
    return found


def _piece_distances(
    views: Views, piece: Piece, triangles: FloatArray, centres: FloatArray, enough_mm: float
) -> FloatArray:
    """(S, V) signed distance of one piece from all triangles in mm, as far as it is not enough."""
    found = np.full(views.shape[::-1], np.inf)
    step = max(1, _LOOKED_AT // len(triangles))
    candidates = [
        _bounds(views, start, step, piece, triangles, centres, enough_mm)
        for start in range(0, views.shape[0], step)
    ]
    state, view, face, bound = (np.concatenate(column) for column in zip(*candidates, strict=True))
    group = state * views.shape[0] + view
    seeming = found.copy().reshape(-1)
    np.minimum.at(seeming, group, bound)
    flat, first = found.reshape(-1), bound == seeming[group]
    # First what seems to be nearest in each view; the others only where they may be nearer still.
    for chosen in (np.flatnonzero(first), np.flatnonzero(~first)):
        chosen = chosen[bound[chosen] < np.minimum(flat[group[chosen]], enough_mm)]
        placed = _in_camera(views, triangles, state[chosen], view[chosen], face[chosen])
        placed += centres[state[chosen]][:, None]
        groups = group[chosen]
        distance = separation_mm(piece, placed, groups, enough_mm, bound[chosen])
        np.minimum.at(flat, groups, distance)
    return found


def _bounds(
    views: Views,
    start: int,
    step: int,
    piece: Piece,
    triangles: FloatArray,
    centres: FloatArray,
    enough_mm: float,
) -> tuple[IntArray, IntArray, IntArray, FloatArray]:
    """States, views and triangles that are not known to be far enough, and lower bounds in mm."""
    block = views.some(slice(start, start + step))
    pose, view, face = _near(block, piece, triangles, centres, enough_mm)
    # Directions are tried at the middle state; from there their bounds are linear.
    middle = (centres.min(axis=0) + centres.max(axis=0)) / 2
    in_camera = _in_camera(block, triangles, pose, view, face)
    directions, gaps = directions_apart(piece, in_camera + middle)
    shift = centres - middle
    if block.positions_mm.shape[1] > 1:
        bound = (gaps + np.einsum("ckj,kj->ck", directions, shift[pose])).max(axis=0)
        kept = bound < enough_mm
        return pose[kept], view[kept] + start, face[kept], bound[kept]
    highest = np.full((len(centres), len(view)), -np.inf)
    for direction, gap in zip(directions, gaps, strict=True):
        np.maximum(highest, shift @ direction.T + gap, out=highest)
    state, pair = np.nonzero(highest < enough_mm)
    return state, view[pair] + start, face[pair], highest[state, pair]


def _near(
    views: Views, piece: Piece, triangles: FloatArray, centres: FloatArray, enough_mm: float
) -> tuple[IntArray, IntArray, IntArray]:
    """Poses, viewpoints and triangles that may be nearer to a piece than what is enough.

    The piece, sweeping along the axis through all states, is held in a cylinder about the axis, the
    triangle in a ball. Most views end here.
    """
    middles, radii = _balls(triangles)
    x, y, z = views.in_camera(middles)
    low, high, away = piece.extent_mm
    lowest, highest = centres.min(axis=0), centres.max(axis=0)
    middle, spread = (lowest + highest) / 2, (highest - lowest) / 2
    sideways = np.hypot(x + middle[0], y + middle[1])
    sideways -= away + np.hypot(spread[0], spread[1])
    ahead = np.abs(z + middle[2] - (low + high) / 2)
    ahead -= spread[2] + (high - low) / 2
    np.maximum(sideways, 0.0, out=sideways)
    np.maximum(ahead, 0.0, out=ahead)
    pose, face, view = np.nonzero(
        sideways**2 + ahead**2 < ((enough_mm + radii) ** 2)[None, :, None]
    )
    return pose, view, face


def _in_camera(
    views: Views, triangles: FloatArray, state: IntArray, view: IntArray, face: IntArray
) -> FloatArray:
    """(K, 3, 3) triangles in the frame of the camera at views."""
    pose = state if views.positions_mm.shape[1] > 1 else np.zeros_like(state)
    away = triangles[face] - views.positions_mm[view, pose][:, None]
    return np.asarray(away @ views.rotations[view, pose])


def _balls(triangles: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(F, 3) centres and (F,) radii of balls that hold the triangles, nearly the smallest."""
    sides = np.roll(triangles, -1, axis=1) - triangles
    squared = np.einsum("fij,fij->fi", sides, sides)
    longest = squared.argmax(axis=1)
    rows = np.arange(len(triangles))
    # About the middle of the longest side a right or obtuse triangle is held by half that side.
    middles = triangles[rows, longest] + sides[rows, longest] / 2
    reach = np.linalg.norm(triangles - middles[:, None], axis=-1).max(axis=1)
    return middles, reach


def _mark_inside(
    views: Views, piece: Piece, scene: Scene, centres: FloatArray, found: FloatArray
) -> None:
    """Turn the sign where a piece that touches no surface lies within material."""
    positions = views.positions_mm.transpose(1, 0, 2)
    rotations = views.rotations.transpose(1, 0, 2, 3)
    local = piece.centre_mm - centres
    # (S, V, 3) the middle of the piece in the frame of the part.
    spots = positions + np.einsum(
        "pvij,pj->pvi" if len(positions) > 1 else "pvij,sj->svi", rotations, local
    )
    inside = _inside_some_body(spots, scene) & (found > 0)
    if inside.any():
        surface = np.full(found.shape, np.inf)
        for body in scene.bodies:
            surface[inside] = np.minimum(
                surface[inside], body.distance_to_surface_mm(spots[inside])
            )
        found[inside] = -surface[inside]


def _inside_some_body(points: FloatArray, scene: Scene) -> BoolArray:
    inside = np.zeros(points.shape[:-1], dtype=bool)
    for body in scene.bodies:
        low, high = body.bounds_mm
        near = ((points >= low) & (points <= high)).all(axis=-1)
        if near.any():
            inside[near] |= body.contains(points[near])
    return inside
