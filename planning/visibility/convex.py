"""Convex pieces that hide what lies behind them, one or many in a few arrays."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import trimesh
from manifold3d import Manifold

from lenscal.arrays import BoolArray, FloatArray, IntArray
from planning.boolean import from_manifold


@dataclass(frozen=True, slots=True, eq=False)
class ConvexPiece:
    """A convex polygon or polyhedron that hides what lies behind it.

    Parameters
    ----------
    vertices
        (V, 3) corners.
    edges
        (E, 2) indices of the ends of its edges.
    normals
        (F, 3) unit normals of its faces; one for a polygon.
    offsets
        (F,) normal · point of each face.
    """

    vertices: FloatArray
    edges: IntArray
    normals: FloatArray
    offsets: FloatArray

    @classmethod
    def polygon(cls, corners: FloatArray) -> ConvexPiece:
        """Make a piece of a polygon.

        Parameters
        ----------
        corners
            (N, 3) corners in order.

        Returns
        -------
        ConvexPiece
            The piece.
        """
        local = corners - corners[0]
        normal = np.cross(local, np.roll(local, -1, axis=0)).sum(axis=0)
        normal = normal / np.linalg.norm(normal)
        index = np.arange(len(corners))
        edges = np.stack([index, np.roll(index, -1)], axis=-1)
        return cls(corners, edges, normal[None], (corners @ normal).mean(keepdims=True))

    @classmethod
    def hull(cls, points: FloatArray) -> ConvexPiece:
        """Make a piece of the convex hull of points.

        Parameters
        ----------
        points
            (N, 3) points, not all in one plane.

        Returns
        -------
        ConvexPiece
            The piece.
        """
        vertices, faces = from_manifold(Manifold.hull_points(np.ascontiguousarray(points)))
        mesh = trimesh.Trimesh(vertices, faces, process=False)
        pairs = mesh.face_adjacency
        turn = np.linalg.norm(
            np.cross(mesh.face_normals[pairs[:, 0]], mesh.face_normals[pairs[:, 1]]), axis=-1
        )
        # A corner in the middle of an edge makes a triangle without an area, thus without a normal.
        all_normals = np.asarray(mesh.face_normals)
        flat = np.linalg.norm(all_normals, axis=-1) == 0
        real = (turn > 1e-12) | flat[pairs].any(axis=1)
        normals = all_normals[~flat]
        offsets = np.einsum("fi,fi->f", normals, vertices[faces[~flat, 0]])
        return cls(vertices, np.asarray(mesh.face_adjacency_edges)[real], normals, offsets)


@dataclass(frozen=True, slots=True, eq=False)
class ConvexPieces:
    """Convex pieces of a scene, all in a few arrays, nearest to the origin first.

    Parameters
    ----------
    corners
        (C, 3) corners of all pieces, one piece after the other.
    starts
        (N + 1,) where the corners of each piece start.
    flat
        (N,) whether a piece is a polygon, with its corners in order. The others are solids.
    triangles
        (F, 3, 3) surfaces of all pieces.
    owners
        (F,) the piece that each triangle belongs to.
    """

    corners: FloatArray
    starts: IntArray
    flat: BoolArray
    triangles: FloatArray
    owners: IntArray

    def __len__(self) -> int:
        """Count the pieces."""
        return len(self.flat)

    def corners_of(self, index: int) -> FloatArray:
        """Give the corners of one piece.

        Parameters
        ----------
        index
            Its number.

        Returns
        -------
        FloatArray
            (K, 3) corners.
        """
        return self.corners[self.starts[index] : self.starts[index + 1]]

    def boxes_of(self, which: IntArray) -> tuple[FloatArray, FloatArray]:
        """Give the boxes about pieces.

        Parameters
        ----------
        which
            (M,) their numbers.

        Returns
        -------
        low, high : FloatArray
            (M, 3) lowest and highest coordinates of each.
        """
        counts = np.diff(self.starts)[which]
        corners = self.corners[_runs(self.starts[which], counts)]
        starts = np.cumsum(counts) - counts
        return np.minimum.reduceat(corners, starts), np.maximum.reduceat(corners, starts)

    def piece(self, index: int) -> ConvexPiece:
        """Give one piece with its edges and faces.

        Parameters
        ----------
        index
            Its number.

        Returns
        -------
        ConvexPiece
            The piece.
        """
        corners = self.corners_of(index)
        return ConvexPiece.polygon(corners) if self.flat[index] else ConvexPiece.hull(corners)

    @classmethod
    def gathered(
        cls, polygons: Iterable[FloatArray], solids: Iterable[tuple[FloatArray, IntArray]]
    ) -> ConvexPieces:
        """Collect polygons and solids.

        Parameters
        ----------
        polygons
            (N, K, 3) arrays of polygons, corners in order, the first one repeated to fill up rows.
        solids
            Convex solids: (V, 3) corners and (F, 3) indices of each.

        Returns
        -------
        ConvexPieces
            All of them, nearest first.
        """
        corners, counts, flat, triangles, owned = [], [], [], [], []
        for batch in polygons:
            used = (batch != batch[:, :1]).any(axis=-1)
            used[:, 0] = True
            corners.append(batch[used])
            counts.append(used.sum(axis=1))
            flat.append(np.ones(len(batch), dtype=bool))
            fan = np.stack(
                [np.broadcast_to(batch[:, :1], batch[:, 2:].shape), batch[:, 1:-1], batch[:, 2:]], 2
            )
            real = used[:, 1:-1] & used[:, 2:]
            triangles.append(fan[real])
            owned.append(real.sum(axis=1))
        for vertices, faces in solids:
            corners.append(vertices)
            counts.append(np.array([len(vertices)]))
            flat.append(np.zeros(1, dtype=bool))
            triangles.append(vertices[faces])
            owned.append(np.array([len(faces)]))
        if not counts:
            nothing = np.zeros(0, dtype=np.int64)
            none = np.zeros((0, 3))
            return cls(none, np.zeros(1, dtype=np.int64), nothing > 0, none[:, None], nothing)
        return _nearest_first(
            np.concatenate(corners),
            np.concatenate(counts),
            np.concatenate(flat),
            np.concatenate(triangles),
            np.concatenate(owned),
        )


def _nearest_first(
    corners: FloatArray, counts: IntArray, flat: BoolArray, triangles: FloatArray, owned: IntArray
) -> ConvexPieces:
    starts = np.cumsum(counts) - counts
    distance = np.minimum.reduceat(np.linalg.norm(corners, axis=-1), starts)
    order = np.argsort(distance, kind="stable")
    rows = _runs(starts[order], counts[order])
    owners = np.repeat(np.arange(len(order)), owned[order])
    return ConvexPieces(
        corners[rows],
        np.concatenate([[0], np.cumsum(counts[order])]),
        flat[order],
        triangles[_runs((np.cumsum(owned) - owned)[order], owned[order])],
        owners,
    )


def _runs(starts: IntArray, counts: IntArray) -> IntArray:
    """Indices start, start + 1, … of many runs, one after the other."""
    total = np.cumsum(counts)
    runs: IntArray = np.repeat(starts - (total - counts), counts) + np.arange(counts.sum())
    return runs
