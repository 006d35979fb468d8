"""Clearance: lens and camera keep away from everything in the scene."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from lenscal.arrays import BoolArray, FloatArray, IntArray, positive
from lenscal.errors import InputError, PlanningError
from lenscal.sensor import Sensor
from planning.camera_body import CameraBody, Piece
from planning.requirements.margin import Margin, margin_over
from planning.scene import Scene
from planning.separation import separation_mm
from planning.views import Views


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
    for piece in body.pieces:
        for view, state, face in _near(views, piece, triangles, centres, enough_mm):
            placed = _in_reference(views, triangles[face], view, state, centres)
            group = state * viewpoints + view
            distance = separation_mm(piece, placed, group, enough_mm)
            np.minimum.at(found.reshape(-1), group, distance)
        _mark_inside(views, piece, scene, centres, found)
    return found


def _near(
    views: Views, piece: Piece, triangles: FloatArray, centres: FloatArray, enough_mm: float
) -> Iterator[tuple[IntArray, IntArray, IntArray]]:
    """Views, states and triangles that may be nearer to a piece than what is enough.

    The piece is held in a cylinder about the optical axis, the triangle in a ball. All states are
    looked at together first, the piece sweeping along the axis; most views end there.
    """
    middles, radii = _balls(triangles)
    x, y, z = views.in_camera(middles)
    low, high, away = piece.extent_mm
    middle = (centres.min(axis=0) + centres.max(axis=0)) / 2
    spread = np.ptp(centres, axis=0) / 2
    sideways = np.hypot(x + middle[0], y + middle[1]) - away - np.hypot(spread[0], spread[1])
    ahead = np.abs(z + middle[2] - (low + high) / 2) - spread[2] - (high - low) / 2
    reach = enough_mm + radii[None, :, None]
    together = (sideways < reach) & (ahead < reach)
    pose, face, view = np.nonzero(together)
    if not len(view):
        return
    if len(x) == 1:
        state = np.repeat(np.arange(len(centres)), len(view))
        pose, face, view = (np.tile(a, len(centres)) for a in (pose, face, view))
    else:
        state = pose
    shift = centres[state]
    sideways = np.hypot(x[pose, face, view] + shift[:, 0], y[pose, face, view] + shift[:, 1]) - away
    ahead = np.abs(z[pose, face, view] + shift[:, 2] - (low + high) / 2) - (high - low) / 2
    apart = np.hypot(np.maximum(sideways, 0.0), np.maximum(ahead, 0.0)) - radii[face]
    kept = apart < enough_mm
    yield view[kept], state[kept], face[kept]


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


def _in_reference(
    views: Views, triangles: FloatArray, view: IntArray, state: IntArray, centres: FloatArray
) -> FloatArray:
    """(K, 3, 3) triangles in the frame of the reference camera at each view and state."""
    pose = state if views.positions_mm.shape[1] > 1 else np.zeros_like(state)
    away = triangles - views.positions_mm[view, pose][:, None]
    placed: FloatArray = away @ views.rotations[view, pose] + centres[state][:, None]
    return placed


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
