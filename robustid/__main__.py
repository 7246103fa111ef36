"""``python -m robustid``: the command line."""

from robustid.cli import main

if __name__ == "__main__":
    main()
