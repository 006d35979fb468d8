"""Unvignetted: all of the entrance pupil sees the target, not only its centre.

What stands between a part of the pupil and the target darkens the image and shifts it: a point of
the target that is out of focus is then seen from the middle of what is left of the pupil.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from lenscal.arrays import FloatArray
from lenscal.errors import InputError, PlanningError
from lenscal.sensor import Sensor
from planning.requirements.margin import Margin, margin_over
from planning.views import Views

#: Pairs of view and triangle that are worked on at once.
_PAIRS_AT_ONCE: Final = 100_000


@dataclass(frozen=True, slots=True)
class Unvignetted:
    """The disk of the entrance pupil lies in the visibility region.

    The disk is perpendicular to the optical axis, about the projection centre. The region ends
    where the workspace does, and so must the disk.
    """

    @property
    def name(self) -> str:
        """``unvignetted``."""
        return "unvignetted"

    @property
    def judges_all_at_once(self) -> bool:
        """True: the few views near to the boundary are worked on together."""
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
            (V, S) by how many mm the largest disk in the region exceeds the pupil's radius; the
            share is of that radius. It says no more than one radius, a share of 1. Where the
            projection centre itself is outside, the disk counts as negative by its distance.

        Raises
        ------
        InputError
            When the subject has no region.
        PlanningError
            When the entrance pupil is not known.
        """
        pupil = views.states.entrance_pupil_diameter_mm
        if pupil is None:
            raise PlanningError(
                "whether the entrance pupil is free needs its diameter, which is not known here; "
                "name an iris at which the map knows it, or give FixedLens(..., "
                "entrance_pupil_diameter_mm=...)"
            )
        largest = views.region_distance_mm.copy()
        # A ball about the centre holds the disk: most views need no more than that.
        near = (largest > 0) & (largest < pupil.max())
        region = views.subject.region
        if near.any() and region is not None:
            axes = np.broadcast_to(views.axes, views.positions_mm.shape)[near]
            largest[near] = disk_radius_mm(
                views.positions_mm[near], axes, region.solid.triangles_mm
            )
        radius = pupil[:, None] / 2
        spare = np.minimum(largest.T - radius, radius)
        return margin_over(views, spare, "mm", spare / radius, self.describe(views.states.sensor))

    def describe(self, sensor: Sensor) -> str:  # noqa: ARG002
        """Say what is asked.

        Parameters
        ----------
        sensor
            The sensor.

        Returns
        -------
        str
            "visibility from all of the entrance pupil".
        """
        return "visibility from all of the entrance pupil"


def disk_radius_mm(
    centres_mm: FloatArray, normals: FloatArray, triangles_mm: FloatArray
) -> FloatArray:
    """Give the radius of the largest disk that a closed surface leaves free.

    Parameters
    ----------
    centres_mm
        (K, 3) centres in mm.
    normals
        (K, 3) unit normals of the disks.
    triangles_mm
        (F, 3, 3) the surface in mm.

    Returns
    -------
    FloatArray
        (K,) distance in mm from the centre to the line in which the disk's plane cuts the surface;
        infinite where it does not.
    """
    if centres_mm.shape != normals.shape:
        raise InputError(
            f"{len(centres_mm)} disks need as many normals, but there are {len(normals)}"
        )
    radius = np.full(len(centres_mm), np.inf)
    step = max(1, _PAIRS_AT_ONCE // max(1, len(triangles_mm)))
    for start in range(0, len(centres_mm), step):
        part = slice(start, start + step)
        heights = np.einsum("fic,kc->kfi", triangles_mm, normals[part])
        heights -= np.einsum("kc,kc->k", centres_mm[part], normals[part])[:, None, None]
        above = heights >= 0
        view, face = np.nonzero(above.any(axis=2) & ~above.all(axis=2))
        if not len(view):
            continue
        corners = triangles_mm[face] - centres_mm[part][view, None]
        height, up = heights[view, face], above[view, face]
        # The corner that is alone on its side: the cut runs from one of its edges to the other.
        alone = np.where(up.sum(axis=1) == 1, up.argmax(axis=1), up.argmin(axis=1))
        rows = np.arange(len(view))
        tip, tip_height = corners[rows, alone], height[rows, alone]
        ends = []
        for turn in (1, 2):
            other = (alone + turn) % 3
            share = tip_height / (tip_height - height[rows, other])
            ends.append(tip + share[:, None] * (corners[rows, other] - tip))
        along = ends[1] - ends[0]
        squared = np.einsum("ij,ij->i", along, along)
        foot = -np.einsum("ij,ij->i", ends[0], along) / np.where(squared > 0, squared, 1.0)
        nearest = ends[0] + np.clip(foot, 0.0, 1.0)[:, None] * along
        np.minimum.at(radius[part], view, np.linalg.norm(nearest, axis=1))
    return radius
