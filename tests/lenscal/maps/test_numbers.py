"""Tables with cells that are no numbers, through everything that takes a table."""

import numpy as np
import pandas as pd
import pytest

from lenscal.errors import InputError
from lenscal.maps.consistency import check_consistency
from lenscal.maps.fit import fit_lens_map
from lenscal.maps.numbers import in_numbers
from lenscal.maps.validation import cross_validate


@pytest.mark.parametrize("ask", [fit_lens_map, check_consistency, cross_validate])
@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        ("magnification", "abc", "magnification must be a number, but is 'abc' in row 3"),
        ("zoom", "one", "zoom must be a number, but is 'one' in row 3"),
        ("k1_per_mm2", np.inf, "k1_per_mm2 must be a number, but is inf in row 3"),
        ("sigma_magnification", np.inf, "sigma_magnification must be a number, but is inf"),
        ("nodal_x_mm", -np.inf, "nodal_x_mm must be a number, but is -inf in row 3 of the table"),
    ],
)
def test_a_cell_that_is_no_number_is_named(lens, grid, ask, column, value, message):
    table = lens.sample(*grid).assign(k1_per_mm2=1e-5, nodal_x_mm=np.linspace(0, 1, len(grid[0])))
    table[column] = table[column].astype(object)
    table.loc[3, column] = value
    with pytest.raises(InputError, match=message):
        ask(table)


@pytest.mark.parametrize("ask", [fit_lens_map, check_consistency, cross_validate])
def test_a_table_without_rows_is_refused(lens, grid, ask):
    with pytest.raises(InputError, match="has no row; calibrate at least two settings"):
        ask(lens.sample(*grid).iloc[:0])


def test_numbers_in_words_and_columns_of_other_meaning_pass():
    table = pd.DataFrame({"zoom": ["1", "2"], "focus": [0, None], "approach": ["below", "above"]})
    found = in_numbers(table.set_index(pd.Index([5, 6])))
    assert found["zoom"].tolist() == [1.0, 2.0]
    assert np.isnan(found["focus"][1])
    assert found["approach"].tolist() == ["below", "above"]
