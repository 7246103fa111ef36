"""``python -m robustid``: the command line."""

from robustid.app.cli.main import main

if __name__ == "__main__":
    main()
