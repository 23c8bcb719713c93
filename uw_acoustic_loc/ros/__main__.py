"""`python -m uw_acoustic_loc.ros EXECUTABLE --ros-args ...`: one node in one process."""

import sys

from .executables import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
