"""What holds for all tests: none is timed, so a kernel that is loaded late fails nothing.

A shell that runs tests in the background has them, and the processes they start, ignore Ctrl-C;
some tests send it, so it is heard again.

Where CI is set, Hypothesis tries the same examples in every run; elsewhere it looks for new ones.
"""

import os
import signal

from hypothesis import settings

settings.register_profile("untimed", deadline=None, derandomize=bool(os.environ.get("CI")))
settings.load_profile("untimed")

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
