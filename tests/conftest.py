"""What holds for all tests."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

# Property tests try the same examples everywhere, so that a failure can be repeated by anyone, and
# take the time that a busy machine needs. Look for new ones with
# `pytest --hypothesis-profile default --hypothesis-seed 7`.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")


@pytest.fixture
def reference_data() -> Path:
    """Folder of the reference data, or a skip that says so."""
    folder = os.environ.get("LENSCAL_REFERENCE_DATA")
    if not folder or not Path(folder).is_dir():
        pytest.skip("LENSCAL_REFERENCE_DATA does not name the folder of reference data")
    return Path(folder)
