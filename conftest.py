"""What holds for all tests: none is timed, so a kernel that is loaded late fails nothing.

Where CI is set, Hypothesis tries the same examples in every run; elsewhere it looks for new ones.
"""

import os

from hypothesis import settings

settings.register_profile("untimed", deadline=None, derandomize=bool(os.environ.get("CI")))
settings.load_profile("untimed")
