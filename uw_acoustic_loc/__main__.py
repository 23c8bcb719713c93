"""`python -m uw_acoustic_loc`: the program `uwloc`."""

import sys

from .cli.main import main

if __name__ == "__main__":
    sys.exit(main())
