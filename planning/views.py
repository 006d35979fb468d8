"""Views: from V poses, at S lens states, of one subject. What every requirement judges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray, frozen_array
from lenscal.camera import Camera
from lenscal.errors import InputError
from lenscal.pose import Pose
from planning.lens_states import LensStates
from planning.scene import Scene
from planning.target import Target
from planning.visibility.region import Region

#: How far a rotation may be from orthonormal.
_ORTHONORMAL = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """What is looked at.

    Parameters
    ----------
    target
        The face that is to be seen whole.
    feature
        The segment or face that is to be resolved, contained and in focus; None for the target.
    scene
        What the lens must not touch; None where no requirement asks.
    region
        From where the target is seen whole; None where no requirement asks.
    """

    target: Target
    feature: Target | None = None
    scene: Scene | None = None
    region: Region | None = None

    @property
    def seen_feature(self) -> Target:
        """The feature, which is the target itself when none was given."""
        return self.target if self.feature is None else self.feature


@dataclass(frozen=True, eq=False)
class Views:
    """V poses of a camera, each at S lens states.

    Parameters
    ----------
    positions_mm
        (V, 1, 3) projection centres in mm in the part's frame, or (V, S, 3) where they differ from
        state to state, as they do when each state is to be in focus.
    rotations
        (V, 1, 3, 3) or (V, S, 3, 3) rotations of part_from_camera.
    states
        The S lens states.
    subject
        What is looked at.

    Raises
    ------
    InputError
        When a shape is wrong, a value is not finite, or a matrix is no rotation.
    """

    positions_mm: FloatArray
    rotations: FloatArray
    states: LensStates
    subject: Subject

    def __post_init__(self) -> None:
        positions = frozen_array("positions_mm", self.positions_mm, ("V", "P", 3))
        rotations = frozen_array("rotations", self.rotations, ("V", "P", 3, 3))
        wanted = (1, len(self.states))
        if positions.shape[:2] != rotations.shape[:2] or positions.shape[1] not in wanted:
            raise InputError(
                f"positions of shape {positions.shape} and rotations of shape {rotations.shape} do "
                f"not fit {len(self.states)} lens states; both need the shape (V, 1, …), or "
                f"(V, {len(self.states)}, …) where they differ from state to state"
            )
        object.__setattr__(self, "positions_mm", positions)
        object.__setattr__(self, "rotations", rotations)
        _refuse_no_rotations(rotations)

    @classmethod
    def of(
        cls, part_from_camera: Pose | Sequence[Pose], states: LensStates, subject: Subject
    ) -> Views:
        """Look from each of a few poses with every lens state.

        Parameters
        ----------
        part_from_camera
            A pose, or V of them.
        states
            The S lens states.
        subject
            What is looked at.

        Returns
        -------
        Views
            V × S views.
        """
        poses = [part_from_camera] if isinstance(part_from_camera, Pose) else part_from_camera
        positions = np.array([pose.translation_mm for pose in poses]).reshape(-1, 1, 3)
        rotations = np.array([pose.rotation for pose in poses]).reshape(-1, 1, 3, 3)
        return cls(positions, rotations, states, subject)

    @classmethod
    def through(cls, camera: Camera, part_from_camera: Pose, subject: Subject) -> Views:
        """Look through one camera from one pose, with the sharp plane through the feature.

        Parameters
        ----------
        camera
            The camera.
        part_from_camera
            Its pose.
        subject
            What is looked at.

        Returns
        -------
        Views
            One view.

        Raises
        ------
        InputError
            When the feature is not in front of the camera.
        """
        middle = part_from_camera.inverse().transform(subject.seen_feature.centroid_mm)
        return cls.of(part_from_camera, LensStates((camera,), middle[2:]), subject)

    @classmethod
    def looking_at(
        cls,
        positions_mm: npt.ArrayLike,
        at_mm: npt.ArrayLike,
        along: npt.ArrayLike,
        states: LensStates,
        subject: Subject,
    ) -> Views:
        """Point the camera at a point, rolled so that a direction lies along the image's x.

        Parameters
        ----------
        positions_mm
            (V, 3), (V, 1, 3) or (V, S, 3) projection centres in mm.
        at_mm
            (3,) the point on the optical axis.
        along
            (3,) a direction in the part's frame, not along the line of sight.
        states
            The S lens states.
        subject
            What is looked at.

        Returns
        -------
        Views
            V × S views.

        Raises
        ------
        InputError
            When a projection centre is the point itself, or the line of sight has the direction.
        """
        positions = frozen_array("positions_mm", positions_mm, ("...", 3))
        positions = positions[:, None] if positions.ndim == 2 else positions
        axis = frozen_array("at_mm", at_mm, (3,)) - positions
        distance = np.linalg.norm(axis, axis=-1, keepdims=True)
        if not (distance > 0).all():
            raise InputError(
                "a camera cannot look at its own projection centre; place it elsewhere"
            )
        z = axis / distance
        direction = frozen_array("along", along, (3,))
        across = direction - (z @ direction)[..., None] * z
        length = np.linalg.norm(across, axis=-1, keepdims=True)
        if not (length > 1e-9 * np.linalg.norm(direction)).all():
            raise InputError(
                "the line of sight runs along the direction that is to lie along the image's x; "
                "give another direction"
            )
        x = across / length
        return cls(positions, np.stack([x, np.cross(z, x), z], axis=-1), states, subject)

    @property
    def shape(self) -> tuple[int, int]:
        """V and S."""
        return len(self.positions_mm), len(self.states)

    @property
    def axes(self) -> FloatArray:
        """(V, P, 3) unit vectors v along the optical axis, in the part's frame."""
        return self.rotations[..., 2]

    def some(self, which: slice) -> Views:
        """Take some of the poses, at all states.

        Parameters
        ----------
        which
            Which of the V.

        Returns
        -------
        Views
            Those.
        """
        return Views(self.positions_mm[which], self.rotations[which], self.states, self.subject)

    def some_states(self, which: slice) -> Views:
        """Take some of the states, with their places where each has its own.

        Parameters
        ----------
        which
            Which of the S.

        Returns
        -------
        Views
            Those.
        """
        own = which if self.positions_mm.shape[1] > 1 else slice(None)
        return Views(
            self.positions_mm[:, own],
            self.rotations[:, own],
            self.states.some(which),
            self.subject,
        )

    def in_camera(self, points_mm: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Give points in the frame of each camera.

        Parameters
        ----------
        points_mm
            (N, 3) in mm in the part's frame.

        Returns
        -------
        x, y, z : FloatArray
            (P, N, V) each in mm, P being 1 or S.
        """
        # One product per component, with the viewpoints innermost.
        rotations = self.rotations.transpose(1, 2, 3, 0)
        positions = self.positions_mm.transpose(1, 2, 0)
        shift = -np.einsum("pcv,pcjv->pjv", positions, rotations)
        x, y, z = (
            np.einsum("nc,pcv->pnv", points_mm, rotations[:, :, axis]) + shift[:, None, axis]
            for axis in range(3)
        )
        return x, y, z

    @cached_property
    def feature_in_camera_mm(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(P, N, V) x, y, z of the corners of the feature in the camera's frame in mm."""
        return self.in_camera(self.subject.seen_feature.vertices_mm)

    @cached_property
    def in_front(self) -> npt.NDArray[np.bool_]:
        """(P, V) whether the whole feature is in front of the projection centre."""
        return np.asarray((self.feature_in_camera_mm[2] > 0).all(axis=1))

    @cached_property
    def region_distance_mm(self) -> FloatArray:
        """(V, P) signed distance of the projection centre from the boundary of the region.

        Raises
        ------
        InputError
            When the subject has no region.
        """
        if self.subject.region is None:
            raise InputError(
                "visibility is judged by the region from which the target is seen, but none was "
                "given; compute it with visibility_region(...) and give Subject(..., region=...)"
            )
        return self.subject.region.distance_to_boundary(self.positions_mm)


def _refuse_no_rotations(rotations: FloatArray) -> None:
    x, y, z = np.moveaxis(rotations, -1, 0)
    turned = np.cross(x, y)
    error = max(
        float(np.abs(np.einsum("...i,...i", a, b) - (a is b)).max(initial=0.0))
        for a, b in ((x, x), (y, y), (z, z), (x, y), (y, z), (z, x))
    )
    if error > _ORTHONORMAL:
        raise InputError(
            f"rotations must be orthonormal matrices, but one is off by {error:.1e}; make them "
            "with Views.looking_at or from poses"
        )
    if (np.einsum("...i,...i", turned, z) < 0).any():
        raise InputError("rotations must be right-handed, but one is a reflection; swap two axes")
