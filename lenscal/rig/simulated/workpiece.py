"""A part on the bench of a simulated rig, instead of the calibration target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lenscal.errors import DeviceError, FileError
from lenscal.imaging.decal import Decal
from lenscal.imaging.raycast import Body
from lenscal.imaging.scene import render_scene
from lenscal.imaging.texture import Float32Image
from lenscal.pose import Pose
from lenscal.rig.simulated.body import LensBody
from lenscal.rig.simulated.lens_truth import LensTruth
from lenscal.sensor import Window

if TYPE_CHECKING:
    from pathlib import Path


@dataclass(frozen=True, slots=True, eq=False)
class Workpiece:
    """Bodies, and pictures that lie on them, somewhere on the bench.

    Parameters
    ----------
    bodies
        In the frame of the part.
    base_from_part
        Where it truly lies.
    decals
        Pictures in the frame of the part.
    """

    bodies: Sequence[Body]
    base_from_part: Pose
    decals: Sequence[Decal] = ()

    def image(self, truth: LensTruth, base_from_camera: Pose, window: Window) -> Float32Image:
        """Form its image.

        Parameters
        ----------
        truth
            Of the lens.
        base_from_camera
            Where the camera truly is, with its projection centre at the origin.
        window
            The part of the image wanted.

        Returns
        -------
        Float32Image
            (height, width) irradiance, white paper 1.
        """
        return render_scene(
            truth.camera,
            base_from_camera.inverse() @ self.base_from_part,
            self.bodies,
            object_distance_mm=truth.object_distance_mm,
            entrance_pupil_diameter_mm=truth.entrance_pupil_diameter_mm,
            decals=self.decals,
            window=window,
            falloff=truth.falloff,
        )

    def refuse_collision(
        self, body: LensBody, front_depth_mm: float, base_from_camera: Pose
    ) -> None:
        """Refuse a part of which a corner is inside the barrel of the lens.

        Parameters
        ----------
        body
            The outside of the lens.
        front_depth_mm
            How far the front glass stands before the projection centre.
        base_from_camera
            Where the camera truly is.

        Raises
        ------
        DeviceError
            When one is.
        """
        camera_from_part = base_from_camera.inverse() @ self.base_from_part
        corners = camera_from_part.transform(np.concatenate([b.vertices_mm for b in self.bodies]))
        behind = front_depth_mm - corners[:, 2]
        inside = (np.hypot(*corners[:, :2].T) < body.barrel_radius_mm) & (behind > 0)
        inside &= behind < body.barrel_length_mm
        if inside.any():
            raise DeviceError(
                f"a corner of the part lies {behind[inside].max():.0f} mm behind the front of the "
                "lens: lens and part have collided; move the camera away"
            )


def bodies_of_file(path: Path, mm_per_unit: float) -> list[Body]:
    """Read the meshes of a CAD file.

    Parameters
    ----------
    path
        An STL, OBJ, PLY or GLB file.
    mm_per_unit
        How many mm one unit of its numbers is.

    Returns
    -------
    list of Body
        One per mesh, grey.

    Raises
    ------
    FileError
        When there is no mesh in it.
    """
    import trimesh

    try:
        meshes = trimesh.load_scene(path, process=False).dump()
    # The readers of trimesh raise whatever their parsers happen to raise.
    except Exception as error:
        raise FileError(f"the simulated rig cannot read the part {path}: {error}") from error
    bodies = [
        Body(m.vertices * mm_per_unit, m.faces) for m in meshes if isinstance(m, trimesh.Trimesh)
    ]
    if not bodies:
        raise FileError(f"the part {path} holds no mesh for the simulated rig to look at")
    return bodies
