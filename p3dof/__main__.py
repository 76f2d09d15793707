"""``python -m p3dof`` is the command ``p3dof``."""

import sys

from p3dof.cli import main

if __name__ == "__main__":
    sys.exit(main())
