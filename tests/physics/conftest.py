"""Property tests without a deadline, because the first call of a compiled function is slow."""

from hypothesis import settings

settings.register_profile("physics", deadline=None)
settings.load_profile("physics")
