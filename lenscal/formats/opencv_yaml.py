"""OpenCV's FileStorage YAML with the keys of its calibration sample."""

from __future__ import annotations

from pathlib import Path

from lenscal.arrays import FloatArray
from lenscal.camera import Camera
from lenscal.document import write_whole


def write_opencv_yaml(path: Path | str, camera: Camera) -> Path:
    """Write a camera for OpenCV.

    Parameters
    ----------
    path
        The file.
    camera
        The camera; its distortion is converted by `Camera.to_opencv`.

    Returns
    -------
    Path
        The file. A comment in it states the worst error of the conversion.
    """
    converted = camera.to_opencv()
    lines = [
        "%YAML:1.0",
        "---",
        f"# worst error of the conversion to OpenCV's model: {converted.worst_error_px:.2g} px",
        f"image_width: {camera.sensor.width_px}",
        f"image_height: {camera.sensor.height_px}",
        *_matrix("camera_matrix", converted.matrix),
        *_matrix("distortion_coefficients", converted.distortion[:, None]),
    ]
    return write_whole(Path(path), "\n".join(lines) + "\n")


def _matrix(name: str, values: FloatArray) -> list[str]:
    rows, columns = values.shape
    return [
        f"{name}: !!opencv-matrix",
        f"   rows: {rows}",
        f"   cols: {columns}",
        "   dt: d",
        f"   data: [ {', '.join(repr(float(v)) for v in values.ravel())} ]",
    ]
