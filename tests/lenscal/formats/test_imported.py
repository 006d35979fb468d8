import pandas as pd
import pytest

from lenscal.errors import InputError
from lenscal.formats.imported import ImportedTable


def test_tables_without_rows_or_settings():
    with pytest.raises(InputError, match="lacks the columns focus; it needs one row per setting"):
        ImportedTable(pd.DataFrame({"zoom": [1.0]}), ())
    with pytest.raises(InputError, match="a table of samples lacks rows"):
        ImportedTable(pd.DataFrame({"zoom": [], "focus": []}), ())
