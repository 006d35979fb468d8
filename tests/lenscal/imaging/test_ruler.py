import numpy as np
import pytest

from lenscal.errors import InputError
from lenscal.imaging.ruler import Ruler


def test_ticks_lie_where_they_are_said_to():
    """Each tick's ink has its middle of mass at its place, and as much of it as its width."""
    ruler = Ruler(25.4, 0.508)
    decal = ruler.decal([-12.7, 0, 0], [12.7, 0, 0], [0, 0, 1])
    line = decal.reflectance[len(decal.reflectance) // 2]
    width = decal.size_mm[0]
    x = ((np.arange(len(line)) + 0.5) / len(line) - 0.5) * width
    ink = (line.max() - line) / np.ptp(line)
    assert len(ruler.ticks_mm) == 51
    for place in ruler.ticks_mm:
        near = np.abs(x - place) < 0.254
        assert (x[near] * ink[near]).sum() / ink[near].sum() == pytest.approx(place, abs=1e-9)
        assert ink[near].mean() == pytest.approx(0.4, abs=0.01)


def test_only_the_ends_are_longest_and_every_fifth_is_longer():
    decal = Ruler(10, 1).decal([0, 0, 0], [1, 0, 0], [0, 0, 1])
    inked = (decal.reflectance < 0.5).sum(axis=0)
    lengths = [inked[50 * (k + 1) - 5 : 50 * (k + 1) + 5].max() for k in range(11)]
    assert lengths[0] == lengths[10] == max(lengths)
    assert lengths[1] == lengths[4] < lengths[5] < lengths[0]


def test_it_runs_from_its_start_and_faces_the_normal():
    decal = Ruler(10, 1).decal([1, 2, 3], [1, 9, 3], [0, 0, 2])
    first, last = decal.scene_from_decal.transform([[-5, 0, 0], [5, 0, 0]])
    np.testing.assert_allclose([first, last], [[1, 2, 3], [1, 12, 3]], atol=1e-12)
    np.testing.assert_allclose(decal.scene_from_decal.rotation[:, 2], [0, 0, -1], atol=1e-12)


def test_what_is_no_ruler():
    with pytest.raises(InputError, match="a ruler of 10 mm holds no whole number of steps of 3 mm"):
        Ruler(10, 3)
    with pytest.raises(InputError, match="width_mm must be a positive number"):
        Ruler(10, 1, 0)
    for towards, normal in (([0, 0, 0], [0, 0, 1]), ([1, 0, 0], [1, 0, 1]), ([1, 0, 0], [0, 0, 0])):
        with pytest.raises(InputError, match="a ruler needs a direction and a normal that stands"):
            Ruler(10, 1).decal([0, 0, 0], towards, normal)
