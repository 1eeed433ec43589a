"""What holds for all tests: none is timed, so a kernel that is loaded late fails nothing."""

from hypothesis import settings

settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")
