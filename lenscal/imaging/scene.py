"""Image formation of a scene with depth: triangles, pictures lying on them, one lamp."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray, frozen_array, positive
from lenscal.camera import Camera
from lenscal.errors import InputError
from lenscal.imaging.aperture import ROUND, Aperture
from lenscal.imaging.blur import BlurFloor, blur_margin_px, signed_blur_mm
from lenscal.imaging.decal import Decal
from lenscal.imaging.falloff import shaded
from lenscal.imaging.formation import window_inside
from lenscal.imaging.layers import BlurLayers
from lenscal.imaging.raycast import Body, Hits, TriangleScene
from lenscal.imaging.texture import Float32Image
from lenscal.pose import Pose
from lenscal.sensor import Window

#: Share of the light that comes from everywhere.
_AMBIENT: Final = 0.25
#: Pixels of a block on a side; its samples are followed at once.
_BLOCK_PX: Final = 96
#: Steps of the first look, in px, which finds how large the blur gets, and how much wider than the
#: window it looks, as a share of its sides.
_LOOK_STEP_PX: Final = 8
_LOOK_MARGIN: Final = 0.25


def render_scene(
    camera: Camera,
    camera_from_scene: Pose,
    bodies: Sequence[Body],
    *,
    object_distance_mm: float,
    entrance_pupil_diameter_mm: float,
    decals: Sequence[Decal] = (),
    window: Window | None = None,
    floor: BlurFloor | None = None,
    falloff: tuple[float, float] = (0.0, 0.0),
    aperture: Aperture = ROUND,
    lamp_direction: npt.ArrayLike | None = None,
    background: float = 0.1,
    samples_per_pixel: int = 4,
) -> Float32Image:
    """Form the image of a scene through the same lens as `lenscal.imaging.formation.render`.

    Surfaces scatter as Lambert says: reflectance times the cosine of the angle of the lamp, a
    quarter of the light coming from everywhere; no shadows are cast. Every sample is blurred by
    its own depth, a·d·|1/z − 1/D| with the floor in quadrature; at borders in depth the blurred
    near surface covers the far one, see `lenscal.imaging.layers`.

    Parameters
    ----------
    camera
        The camera at this lens setting; its frame has its origin in the entrance pupil.
    camera_from_scene
        Where the scene is.
    bodies
        What is in it.
    object_distance_mm
        D of the plane in sharpest focus.
    entrance_pupil_diameter_mm
        a of the iris.
    decals
        Pictures that lie on bodies or float; where they overlap, the later one is on top.
    window
        The part of the image wanted, None for all of it.
    floor
        Diffraction and aberration, None for the defaults of `BlurFloor`.
    falloff
        Coefficients of the relative illumination, see `lenscal.imaging.falloff`.
    aperture
        Shape of the iris; a is the diameter of the disk of the same area.
    lamp_direction
        (3,) direction from the scene to the lamp in the frame of the scene, which is far away;
        None for a lamp at the camera.
    background
        Irradiance where there is nothing.
    samples_per_pixel
        Samples along each axis.

    Returns
    -------
    Float32Image
        (height, width) irradiance of the window; white paper that faces the lamp gives 1.

    Raises
    ------
    InputError
        When the window leaves the frame, a length is not positive, the lamp has no direction, or
        there are no samples.
    """
    positive("object_distance_mm", object_distance_mm, "mm")
    positive("entrance_pupil_diameter_mm", entrance_pupil_diameter_mm, "mm")
    if samples_per_pixel < 1:
        raise InputError(f"samples_per_pixel must be at least 1, but is {samples_per_pixel}")
    view = window_inside(window, camera.sensor)
    lamp = _lamp_in_camera(lamp_direction, camera_from_scene)
    scene = TriangleScene(bodies, camera_from_scene)
    pictures = [
        decal.reduced(_sample_mm(camera, camera_from_scene, decal, samples_per_pixel))
        for decal in decals
    ]

    def look(rays: FloatArray) -> Hits:
        hits = scene.hits(rays)
        for decal, picture in zip(decals, pictures, strict=True):
            decal.cover(hits, rays, camera_from_scene, picture)
        return hits

    def blur_mm(depth_mm: FloatArray) -> Float32Image:
        lengths = object_distance_mm, entrance_pupil_diameter_mm
        return signed_blur_mm(depth_mm, camera, *lengths, floor or BlurFloor())

    first = look(_rays(camera, *_first_look(view)).reshape(-1, 3)).depth_mm
    largest_mm = float(np.abs(blur_mm(first[np.isfinite(first)])).max(initial=0.0))
    margin_x, margin_y = blur_margin_px(largest_mm, camera.sensor.sample_pitch_mm, aperture)
    height, width = view.height + 2 * margin_y, view.width + 2 * margin_x
    layers = BlurLayers(height, width, camera.sensor.sample_pitch_mm)
    for rows, columns in _blocks(height, width):
        u = _sample_places(columns, view.left - margin_x, samples_per_pixel)
        v = _sample_places(rows, view.top - margin_y, samples_per_pixel)
        rays = _rays(camera, u, v)
        hits = look(rays.reshape(-1, 3))
        nothing = ~np.isfinite(hits.depth_mm)
        size = blur_mm(np.where(nothing, 1.0, hits.depth_mm))
        size[nothing] = np.nan
        light = _light(hits, rays.reshape(-1, 3), lamp)
        layers.add(
            (rows, columns),
            _by_pixel(light, rays.shape[:2], samples_per_pixel),
            _by_pixel(size, rays.shape[:2], samples_per_pixel),
        )
    image = layers.composed(background, aperture)
    inner = image[margin_y : margin_y + view.height, margin_x : margin_x + view.width]
    return shaded(np.ascontiguousarray(inner), camera, view, falloff)


def _rays(camera: Camera, u: FloatArray, v: FloatArray) -> FloatArray:
    """(rows, columns, 3) directions with z = 1 through columns u and rows v of the image."""
    pixels = np.stack(np.meshgrid(u, v), axis=-1)
    ideal = camera.undistort((pixels - camera.centre_px) * camera.sensor.sample_pitch_mm)
    return np.concatenate([ideal / camera.image_distance_mm, np.ones((*ideal.shape[:2], 1))], -1)


def _light(hits: Hits, rays: FloatArray, lamp: FloatArray | None) -> FloatArray:
    """Shade by Lambert's law."""
    if lamp is None:
        to_lamp = -rays / np.linalg.norm(rays, axis=-1, keepdims=True)
        cosine = np.einsum("ij,ij->i", hits.normal, to_lamp)
    else:
        cosine = hits.normal @ lamp
    light: FloatArray = hits.reflectance * (_AMBIENT + (1 - _AMBIENT) * np.maximum(cosine, 0.0))
    return light


def _lamp_in_camera(direction: npt.ArrayLike | None, camera_from_scene: Pose) -> FloatArray | None:
    if direction is None:
        return None
    towards = frozen_array("lamp_direction", direction, (3,))
    length = float(np.linalg.norm(towards))
    if not length:
        raise InputError("lamp_direction must point somewhere, but is (0, 0, 0)")
    lamp: FloatArray = camera_from_scene.rotation @ towards / length
    return lamp


def _sample_mm(camera: Camera, camera_from_scene: Pose, decal: Decal, samples: int) -> float:
    """Space between samples at the depth of the middle of a decal."""
    depth_mm = float((camera_from_scene @ decal.scene_from_decal).translation_mm[2])
    pitch_mm = float(camera.sensor.sample_pitch_mm.min())
    return max(pitch_mm * depth_mm / camera.image_distance_mm / samples, 1e-6)


def _first_look(view: Window) -> tuple[FloatArray, FloatArray]:
    """Columns and rows of a coarse grid over the window and around it."""
    u, v = (
        np.arange(first - _LOOK_MARGIN * count, first + (1 + _LOOK_MARGIN) * count, _LOOK_STEP_PX)
        for first, count in ((view.left, view.width), (view.top, view.height))
    )
    return u, v


def _sample_places(pixels: slice, origin: int, n: int) -> FloatArray:
    """Places of n samples in each of some pixels, as pixel coordinates."""
    places = np.arange(n * pixels.start, n * pixels.stop)
    return np.asarray(origin + (places + 0.5) / n - 0.5)


def _by_pixel(samples: npt.NDArray[np.floating], shape: tuple[int, ...], n: int) -> Float32Image:
    """Gather the samples of every pixel on a last axis of their own."""
    rows, columns = shape
    cut = samples.astype(np.float32).reshape(rows // n, n, columns // n, n)
    return np.ascontiguousarray(cut.swapaxes(1, 2)).reshape(rows // n, columns // n, n * n)


def _blocks(height: int, width: int) -> Iterator[tuple[slice, slice]]:
    for top in range(0, height, _BLOCK_PX):
        for left in range(0, width, _BLOCK_PX):
            yield (
                slice(top, min(top + _BLOCK_PX, height)),
                slice(left, min(left + _BLOCK_PX, width)),
            )
