"""The command line as `python -m hystjax`, wherever scripts are installed."""

import sys

from .cli import main

if __name__ == "__main__":
    sys.exit(main())
