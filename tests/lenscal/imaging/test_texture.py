import numpy as np
import pytest

from lenscal.errors import InputError
from lenscal.imaging.texture import TargetSurface
from lenscal.target import Chessboard


def test_reflectance_runs_from_ink_to_white_with_grey_around():
    texture = TargetSurface(Chessboard(4, 3, 2.0), ink=0.1, surroundings=0.4).texture(0.05)
    assert texture.reflectance[0, 0] == pytest.approx(0.4, abs=0.02)
    assert np.median(texture.reflectance[4:30, 4:30]) == pytest.approx(1.0, abs=1e-6)
    # The square right of and below the middle of 5 × 4 squares is the third in its row.
    x, y = texture.origin_texel
    square = texture.reflectance[
        int(y + 0.5 * texture.texels_per_mm[1]) : int(y + 1.5 * texture.texels_per_mm[1]),
        int(x - 0.5 * texture.texels_per_mm[0]) : int(x + 0.5 * texture.texels_per_mm[0]),
    ]
    np.testing.assert_allclose(square, 0.1, atol=1e-6)


@pytest.mark.parametrize("texel_mm", [0.013, 0.05, 0.31])
def test_the_density_is_met_within_a_tenth(texel_mm):
    texture = TargetSurface(Chessboard(4, 3, 2.0)).texture(texel_mm)
    np.testing.assert_allclose(np.array(texture.texels_per_mm) * texel_mm, 1.0, rtol=0.1)


def test_a_target_too_large_for_the_view_is_refused():
    with pytest.raises(InputError, match="cannot be drawn with .* texels per mm"):
        TargetSurface(Chessboard(10, 10, 100.0)).texture(0.01)


def test_a_reflectance_beyond_white_is_refused():
    with pytest.raises(InputError, match="ink must be a reflectance between 0 and 1"):
        TargetSurface(Chessboard(4, 3, 2.0), ink=1.5)
