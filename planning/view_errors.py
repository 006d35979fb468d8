"""What a view becomes when robot and lens are not quite what they are taken for.

The robot is sent so that the sharp plane, by the map's standoff, lies where it is wanted. If the
true standoff is longer by δ, the feature stands δ nearer than D; an error of D itself moves the
projection centre along the axis and the image plane with it, so that the image hardly changes. This
is why d/D, D and standoff are drawn together, as the map's surfaces know them, and D and offset
never apart.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import qmc

from lenscal.arrays import FloatArray
from lenscal.cameras import Cameras
from lenscal.pose import Pose
from planning.fixed_lens import FixedLens
from planning.lens_states import LensStates
from planning.nodal import nodal_point
from planning.placement_covariance import motion_covariance
from planning.robot_cell import RobotCell
from planning.views import Views

if TYPE_CHECKING:
    from lenscal.maps.lens_map import LensMap

#: What is drawn: the motion (6); ln(d/D), ln D, ln standoff; lateral wander (2); principal point
#: (2) and κ1; and ln of the entrance pupil.
_DRAWN: Final = 15
_CAMERA: Final = ("principal_point_x_px", "principal_point_y_px", "k1_per_mm2")


@dataclass(frozen=True, eq=False)
class ViewErrors:
    """How well a lens map and a robot cell are known.

    Parameters
    ----------
    lens
        The lens; a fixed one is taken as known exactly.
    cell
        The robot cell; None for a camera that stands exactly where it is wanted.
    """

    lens: LensMap | FixedLens
    cell: RobotCell | None = None

    def normals(self, count: int, seed: int) -> FloatArray:
        """Draw standard normal numbers, spread more evenly than chance would.

        Parameters
        ----------
        count
            How many draws; best a power of two.
        seed
            Scrambles them.

        Returns
        -------
        FloatArray
            (count, 15).
        """
        drawn: FloatArray = qmc.MultivariateNormalQMC(
            np.zeros(_DRAWN), rng=np.random.default_rng(seed)
        ).random(count)
        return drawn

    def redrawn(self, views: Views, normals: FloatArray) -> Views:
        """Give what views may really be.

        Parameters
        ----------
        views
            (1, K) views, each at its own place, of the lens's states.
        normals
            (J, 15) standard normal numbers.

        Returns
        -------
        Views
            (1, K · J), those of the first view first. Their states say where the projection centre
            truly is in the frame of the reference camera, and with it the body of the lens.
        """
        states, count = views.states, len(normals)
        logarithms = self._logarithms(states, normals[:, 6:9])
        ratio = states.magnification[:, None] * np.exp(logarithms[..., 0])
        distance = states.object_distance_mm[:, None] * np.exp(logarithms[..., 1])
        places, turns, centres = self._poses(views, normals, distance, logarithms[..., 2])
        pupil = states.entrance_pupil_diameter_mm
        redrawn = LensStates(
            self._cameras(states, ratio * distance, normals[:, 11:14]),
            distance.reshape(-1),
            None if states.projection_centre_mm is None else centres.reshape(-1, 3),
            None
            if pupil is None
            else (pupil[:, None] * np.exp(self._pupil(states, normals[:, 14]))).reshape(-1),
            *(np.repeat(setting, count) for setting in states.settings),
        )
        return Views(places.reshape(1, -1, 3), turns.reshape(1, -1, 3, 3), redrawn, views.subject)

    def _logarithms(self, states: LensStates, normals: FloatArray) -> FloatArray:
        """(K, J, 3) errors of ln(d/D), ln D and ln standoff."""
        drawn = np.zeros((len(states), len(normals), 3))
        if isinstance(self.lens, FixedLens):
            return drawn
        zoom, focus, _ = states.settings
        covariance = self.lens.core.covariance_at(zoom, focus)
        known = covariance.shape[-1]
        drawn[..., :known] = np.einsum("kab,jb->kja", _roots(covariance), normals[:, :known])
        return drawn

    def _poses(
        self, views: Views, normals: FloatArray, distance_mm: FloatArray, log_standoff: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(K, J, …) true projection centres, rotations, and centres in the reference camera."""
        states = views.states
        nominal = states.projection_centre_mm
        lateral = np.zeros((len(states), 2))
        if nominal is None or isinstance(self.lens, FixedLens):
            # No robot is known: the camera is moved until the image is sharp, wherever D is.
            nominal = np.zeros((len(states), 3))
            offset = distance_mm - states.object_distance_mm[:, None]
        else:
            zoom, focus, _ = states.settings
            points = [nodal_point(self.lens, z, f) for z, f in zip(zoom, focus, strict=True)]
            lateral = np.array([point.sigma_lateral_mm for point in points])
            standoff = states.object_distance_mm + nominal[:, 2]
            offset = distance_mm - standoff[:, None] * np.exp(log_standoff)
        centres = np.broadcast_to(nominal[:, None], (*offset.shape, 3)).copy()
        centres[..., 2] = -offset
        centres[..., :2] += lateral[:, None] * normals[:, 9:11]
        rotations = np.broadcast_to(views.rotations[0], (len(states), 3, 3))
        positions = np.broadcast_to(views.positions_mm[0], (len(states), 3))
        origins = positions - np.einsum("kij,kj->ki", rotations, nominal)
        motion = self._motions(origins, rotations, nominal, normals[:, :6])
        turns = Rotation.from_rotvec(motion[..., :3].reshape(-1, 3)).as_matrix()
        turns = turns.reshape(*offset.shape, 3, 3)
        local = np.einsum("kjab,kjb->kja", turns, centres) + motion[..., 3:]
        places = origins[:, None] + np.einsum("kab,kjb->kja", rotations, local)
        return places, rotations[:, None] @ turns, centres

    def _motions(
        self, origins: FloatArray, rotations: FloatArray, centres: FloatArray, normals: FloatArray
    ) -> FloatArray:
        """(K, J, 6) small motions of the reference camera in its own frame."""
        if self.cell is None:
            return np.zeros((len(origins), len(normals), 6))
        covariances = [
            motion_covariance(self.cell, Pose(rotation, origin), centre)
            for rotation, origin, centre in zip(rotations, origins, centres, strict=True)
        ]
        moved: FloatArray = np.einsum("kab,jb->kja", _roots(np.stack(covariances)), normals)
        return moved

    def _cameras(
        self, states: LensStates, image_distance_mm: FloatArray, normals: FloatArray
    ) -> Cameras:
        """K · J cameras."""
        count = len(normals)
        errors = np.zeros((len(states), count, len(_CAMERA)))
        if not isinstance(self.lens, FixedLens):
            zoom, focus, _ = states.settings
            for k, name in enumerate(_CAMERA):
                if name in self.lens.quantities:
                    errors[..., k] = self.lens.sigma(name, zoom, focus)[:, None] * normals[:, k]
        known = Cameras.of(states.cameras).take(np.repeat(np.arange(len(states)), count))
        shifts = errors.reshape(-1, len(_CAMERA))
        radial = known.radial.copy()
        radial[:, 0] += shifts[:, 2]
        return replace(
            known,
            image_distance_mm=image_distance_mm.reshape(-1),
            principal_point_px=known.principal_point_px + shifts[:, :2],
            radial=radial,
        )

    def _pupil(self, states: LensStates, normals: FloatArray) -> FloatArray:
        """(K, J) errors of ln a."""
        if isinstance(self.lens, FixedLens) or states.entrance_pupil_diameter_mm is None:
            return np.zeros((len(states), len(normals)))
        sigma = self.lens.sigma_entrance_pupil_diameter_mm(*states.settings)
        errors: FloatArray = (sigma / states.entrance_pupil_diameter_mm)[:, None] * normals
        return errors


def _roots(covariances: FloatArray) -> FloatArray:
    """(K, n, n) matrices whose squares the covariances are; these may be singular."""
    values, vectors = np.linalg.eigh(covariances)
    scaled: FloatArray = vectors * np.sqrt(np.maximum(values, 0.0))[:, None]
    return scaled
