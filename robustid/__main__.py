"""``python -m robustid``: the command line."""

from robustid.app.cli.own_process import start

if __name__ == "__main__":
    start()
