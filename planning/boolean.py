"""Boolean operations on solids through manifold3d, each checked by keeping books of the volumes.

manifold3d works here in double precision (`Mesh64`) and in a frame where all is of size one. It can
return a wrong solid without saying so; what is cut off and what remains must therefore add up to
what there was, or the step is repeated with cutters that are larger by a hair.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Final

import manifold3d
import numpy as np
import numpy.typing as npt
from manifold3d import Manifold

from lenscal.arrays import FloatArray, IntArray
from lenscal.errors import GeometryError

#: By how much of the whole the volumes of a step may fail to add up.
BALANCE_TOLERANCE: Final = 1e-9
#: Components of less than this share of the whole are slivers of rounding.
SLIVER: Final = 1e-9
#: When the volumes do not add up, what is subtracted grows about its middle by these shares, and
#: then the cutters by these distances in units of the frame.
_GROWTHS: Final = (0.0, 1e-12, 1e-11, 1e-10)
_INFLATIONS: Final = (1e-9, 1e-8, 1e-7)
#: How far, in units of the frame, and where the second of two solids is moved when the volumes of
#: their intersection do not add up.
_NUDGES: Final = (0.0, 1e-12, -1e-12, 1e-11, -1e-11, 1e-10)
_ASKEW: Final = (0.36, 0.48, 0.8)
#: By what shares of the size corners are moved when manifold3d, taking a mesh over, collapses
#: slivers and loses a piece with them.
_SHAKES: Final = (0.0, 1e-12, 1e-11, 1e-10)
#: How many cutters are united before they are subtracted, at least, and for each face of the solid:
#: every step costs as much as the solid has faces.
_CHUNK: Final = 32
_CHUNK_PER_FACE: Final = 1 / 512

#: Makes a cutter that is larger by a distance on all sides.
Cutter = Callable[[float], Manifold]


def to_manifold(name: str, vertices: FloatArray, faces: IntArray) -> Manifold:
    """Hand a closed mesh over to manifold3d in double precision.

    Parameters
    ----------
    name
        What the caller calls it; it opens the error message.
    vertices
        (V, 3) corners.
    faces
        (F, 3) indices.

    Returns
    -------
    Manifold
        The solid. Its volume is that of the mesh to 1e-9 of its box; where slivers stand in the way
        of that, corners are moved by up to 1e-10 of its size.

    Raises
    ------
    GeometryError
        When manifold3d does not take it as a manifold, or loses a part of it.
    """
    triangles = np.array(faces, dtype=np.uint64, order="C")
    size = float(np.prod(np.ptp(vertices, axis=0))) if len(faces) else 1.0
    volume, lost = _volume(vertices, faces), np.inf
    for distance in _SHAKES:
        corners = np.array(vertices, dtype=np.float64, order="C")
        if distance:
            # Slivers that are collapsed, and a piece with them, are none when their corners are
            # moved by less than anything that matters. The same shake every time.
            reach = distance * np.ptp(vertices, axis=0).max()
            corners += np.random.default_rng(0).uniform(-reach, reach, corners.shape)
        solid = Manifold(manifold3d.Mesh64(corners, triangles))
        if solid.status() != manifold3d.Error.NoError:
            raise GeometryError(
                f"{name} cannot be used as a solid ({solid.status().name}): some edge or vertex "
                "belongs to more than one sheet of its surface; repair it in the CAD program"
            )
        lost = abs(volume - solid.volume())
        if lost <= BALANCE_TOLERANCE * size:
            return solid
    raise GeometryError(
        f"{name} changed by {lost / size:.1e} of its box when it was taken over for boolean "
        "operations, because some of its faces are slivers; simplify the part about the target, or "
        "move the target by a little"
    )


def _volume(vertices: FloatArray, faces: IntArray) -> float:
    if not len(faces):
        return 0.0
    a, b, c = np.moveaxis(vertices[faces] - vertices[faces[0, 0]], 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def from_manifold(solid: Manifold) -> tuple[FloatArray, IntArray]:
    """Take vertices and faces back from manifold3d.

    Parameters
    ----------
    solid
        The solid.

    Returns
    -------
    vertices : FloatArray
        (V, 3) corners.
    faces : IntArray
        (F, 3) indices.
    """
    mesh = solid.to_mesh64()
    vertices = np.array(mesh.vert_properties, dtype=np.float64)
    faces = np.array(mesh.tri_verts, dtype=np.int64).reshape(-1, 3)
    # Vertices that only differ in what mesh they came from are the same place.
    same = np.arange(len(vertices))
    same[np.array(mesh.merge_from_vert, dtype=np.int64)] = np.array(
        mesh.merge_to_vert, dtype=np.int64
    )
    return vertices[:, :3], same[faces]


def trimmed(solid: Manifold, normal: npt.ArrayLike, offset: float) -> Manifold:
    """Cut a solid by a plane.

    Parameters
    ----------
    solid
        The solid; manifold3d makes a fault of cutting an empty one, this does not.
    normal, offset
        (3,) unit normal, and normal · point of the plane.

    Returns
    -------
    Manifold
        What lies on the side that the normal points to.
    """
    return solid if solid.is_empty() else solid.trim_by_plane(normal, offset)


def intersect(first: Manifold, second: Manifold, guarded: bool = True) -> tuple[Manifold, float]:
    """Intersect two solids and check the books.

    Parameters
    ----------
    first, second
        The solids, in a frame of size about one.
    guarded
        Whether anything is done about volumes that do not add up. Only for showing what happens
        without.

    Returns
    -------
    common : Manifold
        What both share.
    imbalance : float
        By how much the volumes of the parts of the first fail to add up.

    Raises
    ------
    GeometryError
        When they do not add up whatever is tried.
    """
    imbalance = np.inf
    for distance in _NUDGES:
        common, rest = first.split(second.translate(np.multiply(distance, _ASKEW)))
        imbalance = abs(first.volume() - common.volume() - rest.volume())
        if imbalance <= BALANCE_TOLERANCE or not guarded:
            return common, imbalance
    raise _unbalanced(imbalance)


def subtract(
    solid: Manifold,
    cutters: Sequence[Cutter],
    guarded: bool = True,
    volume: Callable[[Manifold], float] = Manifold.volume,
) -> tuple[Manifold, float, int]:
    """Subtract many cutters and check the books at every step.

    Parameters
    ----------
    solid
        What is cut, in a frame of size about one.
    cutters
        Each makes the solid to subtract, larger by the distance it is given.
    guarded
        Whether a step whose volumes do not add up is repeated. Only for showing what happens
        without.
    volume
        Measures a solid; where the solids are images under a map, it measures what they stand for.

    Returns
    -------
    rest : Manifold
        What remains, without slivers.
    imbalance : float
        The largest by which the volumes of a step fail to add up.
    repairs : int
        How many steps had to be repeated with larger cutters.

    Raises
    ------
    GeometryError
        When the volumes of a step do not add up whatever is tried.
    """
    whole = volume(solid)
    worst, repairs = 0.0, 0
    left = list(cutters)
    while left and not solid.is_empty():
        count = max(_CHUNK, int(_CHUNK_PER_FACE * solid.num_tri()))
        chunk, left = left[:count], left[count:]
        solid, imbalance, tries = _subtract_chunk(solid, chunk, whole, guarded, volume)
        worst, repairs = max(worst, imbalance), repairs + (tries > 0)
    return _without_slivers(solid, whole, volume), worst, repairs


def _subtract_chunk(
    solid: Manifold,
    cutters: Sequence[Cutter],
    whole: float,
    guarded: bool,
    volume: Callable[[Manifold], float],
) -> tuple[Manifold, float, int]:
    before = volume(solid)
    imbalance = np.inf
    for tries, united in enumerate(_ever_larger(cutters)):
        removed, rest = solid.split(united)
        imbalance = abs(before - volume(removed) - volume(rest))
        if imbalance <= BALANCE_TOLERANCE * whole or not guarded:
            return rest, imbalance, tries
    raise _unbalanced(imbalance / whole)


def _unbalanced(share: float) -> GeometryError:
    return GeometryError(
        f"the volumes of a boolean operation fail to add up by {share:.1e} of the whole, also with "
        "solids that are slightly larger or elsewhere; simplify the part about the target, or move "
        "the target by a little"
    )


def _ever_larger(cutters: Sequence[Cutter]) -> Iterator[Manifold]:
    """Unite cutters, first as they are, then larger and larger by a hair."""
    united = Manifold.batch_boolean([make(0.0) for make in cutters], manifold3d.OpType.Add)
    for share in _GROWTHS:
        yield _grown(united, share)
    for distance in _INFLATIONS:
        yield Manifold.batch_boolean([make(distance) for make in cutters], manifold3d.OpType.Add)


def _grown(solid: Manifold, share: float) -> Manifold:
    if share == 0 or solid.is_empty():
        return solid
    box = np.array(solid.bounding_box())
    middle = (box[:3] + box[3:]) / 2
    return solid.translate(-middle).scale([1 + share] * 3).translate(middle)


def _without_slivers(
    solid: Manifold, whole: float, volume: Callable[[Manifold], float]
) -> Manifold:
    components = solid.decompose()
    # A cavity is a component of negative volume.
    kept = [c for c in components if abs(volume(c)) > SLIVER * whole]
    if len(kept) == len(components):
        return solid
    return Manifold.compose(kept)
