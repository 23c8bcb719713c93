"""`python -m uw_acoustic_loc`: the program `uwloc`."""

import signal
import sys

signal.signal(signal.SIGINT, signal.SIG_DFL)  # while modules are imported, Ctrl-C ends the program without a traceback

from .cli.main import main  # noqa: E402

if __name__ == "__main__":
    sys.exit(main())
