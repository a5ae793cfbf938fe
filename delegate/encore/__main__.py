"""`python -m encore` is the program `encore`."""

import sys

from encore.cli import main

if __name__ == "__main__":
    sys.exit(main())
