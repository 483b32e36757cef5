"""Property tests without a deadline: the first call of a compiled function takes as long as it takes."""

from hypothesis import settings

settings.register_profile("physics", deadline=None)
settings.load_profile("physics")
