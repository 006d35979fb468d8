"""A lens and parts whose answers are known without computing."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from lenscal.camera import Camera
from lenscal.errors import OutOfDomainError
from lenscal.sensor import Sensor
from lenscal.setting import LensSetting
from planning.scene import Scene
from planning.solid import Solid, box_workspace
from planning.target import Target


@dataclass(frozen=True)
class Domain:
    """A rectangle of settings."""

    zoom: tuple[float, float] = (90.0, 109.0)
    focus: tuple[float, float] = (40.0, 140.0)
    is_rectangle: bool = True

    def contains(self, zoom, focus):
        zoom, focus = np.broadcast_arrays(zoom, focus)
        return (
            (zoom >= self.zoom[0])
            & (zoom <= self.zoom[1])
            & (focus >= self.focus[0])
            & (focus <= self.focus[1])
        )


@dataclass(frozen=True)
class AnalyticLens:
    """A lens map in closed form, with the ranges of the paper's lens: d/D from 0.14 to 0.35."""

    sensor: Sensor
    domain: Domain = field(default_factory=Domain)
    reference_setting: LensSetting | None = None
    has_standoff: bool = True
    digest: str = "analytic"
    k1_per_mm2: float = 0.0
    pupil: None = None

    def magnification(self, zoom, focus, outside="raise"):
        u, w = self._unit(zoom, focus, outside)
        return 0.14 * 2.5 ** (0.75 * u + 0.25 * w)

    def object_distance_mm(self, zoom, focus, outside="raise"):
        u, w = self._unit(zoom, focus, outside)
        return 720.0 - 150.0 * u**2 - 60.0 * w

    def standoff_mm(self, zoom, focus, outside="raise"):
        u, w = self._unit(zoom, focus, outside)
        return 385.0 - 15.0 * w + 0.0 * u

    def image_distance_mm(self, zoom, focus, outside="raise"):
        return self.magnification(zoom, focus, outside) * self.object_distance_mm(
            zoom, focus, outside
        )

    def nodal_offset_mm(self, zoom, focus, outside="raise"):
        return self.object_distance_mm(zoom, focus, outside) - self.standoff_mm(
            zoom, focus, outside
        )

    quantities = ("magnification", "object_distance_mm", "image_distance_mm")

    def camera_at(self, zoom, focus):
        return self.cameras_at([zoom], [focus])[0]

    def cameras_at(self, zoom, focus):
        distances = self.image_distance_mm(zoom, focus)
        return tuple(Camera(self.sensor, float(d), self.k1_per_mm2) for d in distances)

    def _unit(self, zoom, focus, outside):
        zoom, focus = np.broadcast_arrays(np.asarray(zoom, float), np.asarray(focus, float))
        mask = ~self.domain.contains(zoom, focus)
        if mask.any() and outside != "nan":
            raise OutOfDomainError("outside of the domain", self.domain, mask)
        u, w = (zoom - 90.0) / 19.0, (focus - 40.0) / 100.0
        return np.where(mask, np.nan, u), np.where(mask, np.nan, w)


@pytest.fixture(scope="session")
def paper_sensor() -> Sensor:
    """The sensor and frame grabber of the paper."""
    return Sensor(512, 480, 0.023, 0.01375, scale_factor=0.70642)


@pytest.fixture(scope="session")
def lens(paper_sensor: Sensor) -> AnalyticLens:
    """A zoom lens in closed form."""
    return AnalyticLens(paper_sensor)


def box(low, high) -> trimesh.Trimesh:
    """Box between two corners."""
    return trimesh.creation.box(bounds=[low, high])


@pytest.fixture(scope="session")
def bench() -> SimpleNamespace:
    """A 10 × 10 target on a block, and a workspace of 100³ in front of it."""
    square = np.array([[-5.0, -5, 0], [5, -5, 0], [5, 5, 0], [-5, 5, 0]])
    return SimpleNamespace(
        square=square,
        target=Target(square),
        block=box((-5, -5, -5), (5, 5, 0)),
        workspace=box_workspace((-50, -50, 0), (50, 50, 100)),
        volume=1e6,
        scene=lambda *meshes: Scene(meshes),
        solid=Solid,
        box=box,
    )
