"""From images to observations: find a target and measure its points to a fraction of a pixel.

OpenCV's pixel convention is ours: (0, 0) is the centre of the top-left pixel. Corners are refined
in a window of a quarter of the typical distance of neighbours; where the pattern is so
foreshortened that this is too much, the calibration finds the corner out. Points carry the ids of
their target. A chessboard that looks the same upside down (columns plus rows even), and a straight
grid of circles, is numbered so that its first row runs to the right in the image; in a camera that
is rolled by more than 90° the target frame is then turned by 180°, which no calibration minds.
"""

from __future__ import annotations

import glob
from collections import Counter
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray, IntArray
from lenscal.errors import DetectionError, FileError, InputError
from lenscal.plate import Plate
from lenscal.recording import Observation
from lenscal.target import Charuco, Chessboard, CircleGrid, Disk, Target

Image = npt.NDArray[np.uint8]
#: Markers of each dictionary that were found in an image: all boards of a plate share the search.
Markers = dict[str, Any]

#: Half the side of the refinement window over the typical distance of neighbouring corners.
_WINDOW: Final = 0.25
#: Smallest half side in px; below, the gradient of the corner itself does not fit in.
_LEAST_WINDOW: Final = 2
#: Fewest points of a board that are worth an observation: a plane's pose has as many equations.
_LEAST_POINTS: Final = 4
_REFINEMENT: Final = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 60, 1e-3)


def detect(image: Image, target: Target) -> Observation:
    """Find a target in an image.

    Parameters
    ----------
    image
        (rows, columns) grey values of 8 bits.
    target
        What to look for. A chessboard and a grid of circles must be seen whole; of a ChArUco board,
        and of a plate, whatever is seen counts.

    Returns
    -------
    Observation
        The points found. The disk of a plate is left out: its middle is no well-defined point.

    Raises
    ------
    DetectionError
        When nothing is found.
    InputError
        When the image is not grey with 8 bits, or the target has no points to calibrate with.
    """
    if image.ndim != 2 or image.dtype != np.uint8:
        raise InputError(
            f"images must be (rows, columns) grey values of 8 bits, but this one is {image.dtype} "
            f"of shape {image.shape}"
        )
    ids, pixels = _find(image, target, {})
    if not len(ids):
        raise DetectionError(
            f"{target.spec} was not found; see that all of it (a part, for ChArUco) is in the "
            "picture, sharp, evenly lit, and described as it is"
        )
    return Observation.of(target, ids, pixels)


def load_images(pattern: str) -> list[tuple[str, Image]]:
    """Read grey images of equal size.

    Parameters
    ----------
    pattern
        A path with wildcards, such as ``DIR/left*.jpg``.

    Returns
    -------
    list of (str, Image)
        Name without folder, and (rows, columns) grey values, sorted by name.

    Raises
    ------
    FileError
        When nothing matches, or a file is no image.
    InputError
        When the images are not all of the same size.
    """
    paths = sorted(Path(p) for p in glob.glob(pattern) if Path(p).is_file())
    if not paths:
        raise FileError(f"no images match {pattern!r}: {_what_is_there(Path(pattern).parent)}")
    images = [(path.name, _read(path)) for path in paths]
    sizes = Counter(image.shape for _, image in images)
    (common, _), *others = sizes.most_common()
    if others:
        odd = [name for name, image in images if image.shape != common]
        raise InputError(
            f"the images are of different sizes: most are {common[1]} × {common[0]} px, but not "
            f"{_listed(odd)}; calibrate pictures of one camera and one resolution together"
        )
    return images


def _find(image: Image, target: Target, markers: Markers) -> tuple[IntArray, FloatArray]:
    """Ids and pixels of what is found; both empty when nothing is."""
    match target:
        case Chessboard():
            return _find_chessboard(image, target)
        case Charuco():
            return _find_charuco(image, target, markers)
        case CircleGrid():
            return _find_circles(image, target)
        case Plate():
            parts = [
                _nothing() if isinstance(part, Disk) else _find(image, part, markers)
                for part, _ in target.parts
            ]
            ids = [found + target.first_id(i) for i, (found, _) in enumerate(parts)]
            return np.concatenate(ids), np.concatenate([pixels for _, pixels in parts])
    raise InputError(
        f"{target.spec} has no points to calibrate with; use a chessboard, a ChArUco board or a "
        "grid of circles"
    )


def _nothing() -> tuple[IntArray, FloatArray]:
    return np.zeros(0, dtype=np.int64), np.zeros((0, 2))


def _find_chessboard(image: Image, target: Chessboard) -> tuple[IntArray, FloatArray]:
    size = (target.columns, target.rows)
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    found, corners = cv2.findChessboardCorners(image, size, flags=flags)
    if not found:
        # The sector-based detector is slower, but sees through blur and in the dark.
        found, corners = cv2.findChessboardCornersSB(image, size, flags=cv2.CALIB_CB_EXHAUSTIVE)
    if not found:
        return _nothing()
    grid = np.asarray(corners).reshape(target.rows, target.columns, 2)
    steps = [np.linalg.norm(np.diff(grid, axis=axis), axis=-1).ravel() for axis in (0, 1)]
    refined = _refine(image, grid, _WINDOW * float(np.median(np.concatenate(steps))))
    turned = _upright(refined.reshape(grid.shape), image)
    return np.arange(target.columns * target.rows), turned.reshape(-1, 2)


def _find_charuco(image: Image, target: Charuco, markers: Markers) -> tuple[IntArray, FloatArray]:
    if target.dictionary not in markers:
        markers[target.dictionary] = cv2.aruco.ArucoDetector(target.markers()).detectMarkers(image)
    marker_corners, marker_ids, _ = markers[target.dictionary]
    if marker_ids is None:
        return _nothing()
    own = np.isin(
        marker_ids.ravel(), target.first_id + np.arange(target.columns * target.rows // 2)
    )
    if not own.any():
        return _nothing()
    corners, ids, _, _ = cv2.aruco.CharucoDetector(target.board()).detectBoard(
        image,
        markerCorners=[c for c, mine in zip(marker_corners, own, strict=True) if mine],
        markerIds=marker_ids[own],
    )
    if corners is None or ids is None or len(ids) < _LEAST_POINTS:
        return _nothing()
    rough, number = corners.reshape(-1, 2), ids.ravel().astype(np.int64)
    row, column = np.divmod(number, target.columns - 1)
    apart = np.abs(row[:, None] - row) + np.abs(column[:, None] - column)
    first, second = np.nonzero(np.triu(apart == 1))
    if not len(first):
        return _nothing()
    spacing = float(np.median(np.linalg.norm(rough[first] - rough[second], axis=-1)))
    # The window must not reach into the markers, whose edges would pull at the corner.
    share = min(_WINDOW, (1 - target.marker_mm / target.square_mm) / 2)
    return number, _refine(image, rough, share * spacing)


def _find_circles(image: Image, target: CircleGrid) -> tuple[IntArray, FloatArray]:
    size = (target.columns, target.rows)
    layout = cv2.CALIB_CB_ASYMMETRIC_GRID if target.staggered else cv2.CALIB_CB_SYMMETRIC_GRID
    found, centres = cv2.findCirclesGrid(
        image, size, flags=layout | cv2.CALIB_CB_CLUSTERING, blobDetector=_dots(image.shape)
    )
    if not found:
        return _nothing()
    pixels = centres.reshape(-1, 2).astype(np.float64)
    ids = np.arange(target.columns * target.rows)
    if not target.staggered:
        pixels = _upright(pixels.reshape(target.rows, target.columns, 2)).reshape(-1, 2)
    return ids, pixels


def _dots(shape: tuple[int, ...]) -> Any:
    """Look for dark dots of any size that leaves room for a few of them."""
    # OpenCV's type stubs leave these out.
    wanted = cv2.SimpleBlobDetector_Params()  # type: ignore[attr-defined]
    wanted.minArea, wanted.maxArea = 12.0, shape[0] * shape[1] / 16
    wanted.minDistBetweenBlobs = 3.0
    return cv2.SimpleBlobDetector_create(wanted)  # type: ignore[attr-defined]


def _refine(image: Image, corners: npt.ArrayLike, half_window_px: float) -> FloatArray:
    half = max(_LEAST_WINDOW, round(half_window_px))
    start = np.array(corners, dtype=np.float32).reshape(-1, 1, 2)
    refined = cv2.cornerSubPix(image, start, (half, half), (-1, -1), _REFINEMENT)
    pixels: FloatArray = refined.reshape(-1, 2).astype(np.float64)
    return pixels


def _upright(grid: FloatArray, image: Image | None = None) -> FloatArray:
    """Choose among the turns of a grid (rows, columns, 2) that the detector cannot tell apart.

    A chessboard is told by its colours where they differ: the square inside its first corner is
    black, its neighbour white. What is left is numbered so that its first row runs to the right.
    """
    square = grid.shape[0] == grid.shape[1]
    turns = [np.rot90(grid, k) for k in ((0, 1, 2, 3) if square else (0, 2))]
    if image is not None:
        turns = [t for t in turns if _brightness(image, t, 0) < _brightness(image, t, 1)] or turns
    return max(turns, key=lambda t: float(t[0, -1, 0] - t[0, 0, 0]))


def _brightness(image: Image, grid: FloatArray, column: int) -> float:
    """Grey value in the middle of a square of the first row between corners."""
    x, y = grid[:2, column : column + 2].mean(axis=(0, 1))
    return float(cv2.getRectSubPix(image, (3, 3), (float(x), float(y))).mean())


def _read(path: Path) -> Image:
    # OpenCV complains on the terminal about files that it cannot open; numpy reads them instead.
    data = np.fromfile(path, dtype=np.uint8)
    image = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if len(data) else None
    if image is None:
        raise FileError(f"{path} is no image that OpenCV can read; use PNG, TIFF or JPEG")
    return image.astype(np.uint8)


def _what_is_there(folder: Path) -> str:
    if not folder.is_dir():
        return f"there is no folder {str(folder)!r}"
    names = sorted(path.name for path in folder.iterdir() if path.is_file())
    return f"the folder {str(folder)!r} has {_listed(names) if names else 'no files'}"


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return ", ".join(names[:3]) + more
