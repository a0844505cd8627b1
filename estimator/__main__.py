"""``python -m estimator``: the command line."""

import sys

from estimator.door import main

if __name__ == "__main__":
    sys.exit(main())
