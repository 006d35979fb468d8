"""Clearance: lens and camera keep away from everything in the scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lenscal.arrays import FloatArray, positive
from lenscal.errors import InputError, PlanningError
from lenscal.sensor import Sensor
from planning.body_distances import distances_mm
from planning.camera_body import CameraBody, Piece
from planning.face_bounds import Places
from planning.requirements.margin import Margin, margin_over
from planning.scene import Scene
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
            is of that. It is exact to 1e-4 mm, and never more than it is. It says no more than a
            share of 1: what is twice the distance away, or more, is not measured. Where they
            overlap the distance is negative: how far the body had to move off a surface, along its
            normal or along or across the body; inside of material, at least by what it is from the
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
    places = _places(views, centres)
    faces = np.ascontiguousarray(
        np.concatenate([body.convex_faces_mm for body in scene.bodies]).transpose(1, 2, 0)
    )
    shape = views.shape[::-1]
    found = np.full(shape, np.inf)
    for piece in body.pieces:
        distance = distances_mm(piece, faces, places, enough_mm)
        _mark_inside(places, piece, scene, distance)
        np.minimum(found, distance.reshape(shape), out=found)
    return found


def _places(views: Views, centres: FloatArray) -> Places:
    """Where the reference camera stands: at V places in S states, or at S × V places.

    The origin is that of the middle state, where directions are tried: from there their bounds are
    linear.
    """
    rotations = views.rotations.transpose(2, 3, 1, 0)
    positions = views.positions_mm.transpose(2, 1, 0)
    if views.positions_mm.shape[1] == 1:
        middle = (centres.min(axis=0) + centres.max(axis=0)) / 2
        shifts, offsets = centres - middle, middle[None]
    else:
        shifts, offsets = np.zeros((1, 3)), centres
    origins = positions - np.einsum("ijpv,pj->ipv", rotations, offsets)
    return Places(np.ascontiguousarray(rotations.reshape(3, 3, -1)), origins.reshape(3, -1), shifts)


def _mark_inside(places: Places, piece: Piece, scene: Scene, found: FloatArray) -> None:
    """Turn the sign where a piece that touches no surface lies within material."""
    for row, shift in zip(found, places.shifts_mm, strict=True):
        middle = np.einsum("ijn,j->in", places.rotations, piece.centre_mm - shift)
        middle += places.origins_mm
        free = row > 0
        for body in scene.bodies:
            low, high = body.bounds_mm[..., None]
            near = np.flatnonzero(free & ((middle >= low) & (middle <= high)).all(axis=0))
            inside = near[body.contains(middle[:, near].T)]
            depth = body.distance_to_surface_mm(middle[:, inside].T)
            row[inside] = np.where(row[inside] > 0, -depth, np.maximum(row[inside], -depth))
