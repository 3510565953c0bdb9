"""The command line as `python -m hystjax`, wherever scripts are installed."""

from .cli import run

if __name__ == "__main__":
    run()
