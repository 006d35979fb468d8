"""What holds for all tests."""

from hypothesis import settings

# Property tests try the same examples everywhere, so that a failure can be repeated by anyone. Look
# for new ones with `pytest --hypothesis-profile default --hypothesis-seed 7`.
settings.register_profile("repeatable", derandomize=True)
settings.load_profile("repeatable")
