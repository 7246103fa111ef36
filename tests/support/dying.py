"""What worker processes do in tests of their end."""

import os
import signal
import time
from pathlib import Path


def attempted(folder, item):
    """A line in the file of the item; the process ends in the first attempt of "dies", and in every one of "deadly"."""
    file = Path(folder) / item
    with file.open("a", encoding="utf-8") as attempts:
        attempts.write(f"{os.getpid()}\n")
    time.sleep(0.3 * (item == "long"))
    if item == "deadly" or (item == "dies" and len(file.read_text(encoding="utf-8").splitlines()) == 1):
        os.kill(os.getpid(), signal.SIGKILL)
    return item.upper()
