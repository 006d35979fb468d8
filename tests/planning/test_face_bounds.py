"""What is done for many faces, viewpoints and states at once, against each of them by itself."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from planning.body_distances import distances_mm
from planning.camera_body import Piece
from planning.cylinder import Cylinder
from planning.face_bounds import FaceBounds, Places
from planning.face_groups import face_groups
from planning.hull import Hull
from planning.separation import directions_apart, separation_mm
from planning.solid import Solid

BOX = trimesh.creation.box(bounds=[(-20, -15, 40), (20, 15, 90)])
PIECES: dict[str, Piece] = {
    "barrel": Cylinder((0, 0, 35), (0, 0, 135), 25),
    "beside the axis": Cylinder((30, 5, 20), (30, 5, 90), 12),
    "tilted": Cylinder((10, 0, 20), (60, 30, 90), 12),
    "hull": Hull(Solid(BOX.vertices, BOX.faces)),
}
ENOUGH_MM = 20.0
WORLDS = [(name, shift) for name in PIECES for shift in ("axial", "any", "none")]


def some_faces(generator: np.random.Generator, count: int) -> np.ndarray:
    """Rectangles, and triangles with one corner twice."""
    middle, one, other = generator.normal(size=(3, 3, count))
    middle, one, other = 100 * middle, 20 * one, 20 * np.cross(one, other, axis=0)
    faces = np.stack([middle, middle + one, middle + one + other, middle + other])
    faces[3, :, ::3] = faces[0, :, ::3]
    return faces


def some_places(generator: np.random.Generator, count: int, shift: str) -> Places:
    rotations = Rotation.random(count, random_state=generator).as_matrix().transpose(1, 2, 0)
    shifts = {
        "axial": generator.normal(size=(4, 3)) * (0, 0, 40),
        "any": generator.normal(size=(4, 3)) * (5, 5, 40),
        "none": np.zeros((1, 3)),
    }[shift]
    return Places(np.ascontiguousarray(rotations), generator.normal(size=(3, count)) * 80, shifts)


def in_camera(faces: np.ndarray, places: Places) -> np.ndarray:
    """(N, 4, 3, F) corners in the frames of the reference cameras."""
    away = faces[None] - places.origins_mm.T[:, None, :, None]
    return np.einsum("ijn,ncif->ncjf", places.rotations, away)


def test_groups_hold_every_face_once_as_it_is() -> None:
    faces = some_faces(np.random.default_rng(0), 200)
    box = trimesh.creation.box(extents=(1, 2, 3)).triangles[:, [0, 1, 2, 0]].transpose(1, 2, 0)
    for given, size in ((faces, 60.0), (faces, 1e9), (faces, 0.0), (box, 1e9)):
        groups = face_groups(given, size)
        numbers = np.concatenate([group.numbers for group in groups])
        assert sorted(numbers) == list(range(given.shape[2]))
        for group in groups:
            expected = given[..., group.numbers].transpose(0, 2, 1)
            points = group.vertices_mm + group.centre_mm
            np.testing.assert_allclose(points[group.corners], expected, atol=1e-12)
            assert (np.linalg.norm(group.vertices_mm, axis=1) <= group.radius_mm).all()
            ends = np.sort([group.corners, np.roll(group.corners, -1, axis=0)], axis=0)
            np.testing.assert_array_equal(group.ends[:, group.edges], ends)
    assert len(face_groups(faces, 60.0)) > len(face_groups(faces, 1e9)) > 1
    assert len(groups[0].vertices_mm) == 8
    assert face_groups(np.zeros((4, 3, 0)), 1.0) == []


@pytest.mark.parametrize(("name", "shift"), WORLDS)
def test_bounds_are_those_of_each_face_by_itself(name: str, shift: str) -> None:
    generator = np.random.default_rng(1)
    piece, faces, places = (
        PIECES[name],
        some_faces(generator, 30),
        some_places(generator, 50, shift),
    )
    corners = in_camera(faces, places)
    (group,) = face_groups(faces, 1e9)
    bounds = FaceBounds(piece, group, places)
    found = bounds.in_states()
    assert found.shape == (len(places.shifts_mm), 30, 50)
    for n in range(50):
        gaps = directions_apart(piece, corners[n])
        for s, moved in enumerate(places.shifts_mm):
            expected = np.max(
                [g for d, f, b in gaps for g in (f + moved @ d, b - moved @ d)], axis=0
            )
            # The sine of no angle is rounded to 1e-8 when the axis is tilted.
            np.testing.assert_allclose(
                found[s, :, n], expected, atol=1e-9 + 1e-6 * (name == "tilted")
            )
    # What is reached is the distance of a point: no less than that of the face.
    state, face, place = (k.ravel() for k in np.indices(found.shape))
    reached = bounds.reached(state, face, place)
    known = isinstance(piece, Cylinder) and (shift == "none" or (name, shift) in {
        ("barrel", "axial"), ("beside the axis", "axial")
    })  # fmt: skip
    assert np.isfinite(reached).all() == known
    here = corners[place, :, :, face].transpose(1, 2, 0) + places.shifts_mm[state].T
    exact, _ = separation_mm(piece, here, np.arange(len(state)), 1e9, found.ravel())
    assert (reached >= exact - 1e-9).all()
    if known:
        assert (reached[exact > 1e-3] > 0).all()
        assert np.count_nonzero(reached == 0) >= 4


@pytest.mark.parametrize(("name", "shift"), WORLDS)
def test_distances_are_those_of_all_faces_one_by_one(name: str, shift: str) -> None:
    generator = np.random.default_rng(2)
    piece, faces = PIECES[name], some_faces(generator, 40)
    places = some_places(generator, 20 if name == "hull" else 300, shift)
    found = distances_mm(piece, faces, places, ENOUGH_MM)
    corners = in_camera(faces, places).transpose(1, 2, 0, 3).reshape(4, 3, -1)
    for row, moved in zip(found, places.shifts_mm, strict=True):
        here = corners + moved[:, None]
        known = np.max([g for _, *both in directions_apart(piece, here) for g in both], axis=0)
        exact, _ = separation_mm(piece, here, np.arange(len(known)), 1e9, known)
        expected = exact.reshape(-1, 40).min(axis=1)
        near, apart = expected < ENOUGH_MM - 1e-3, expected > 1e-3
        assert near.any()
        assert (near & apart).any()
        assert (~apart).any()
        np.testing.assert_allclose(row[near & apart], expected[near & apart], atol=2e-4)
        assert (row[~near] >= ENOUGH_MM - 2e-3).all()
        assert (row[~apart] <= 1e-3).all()
