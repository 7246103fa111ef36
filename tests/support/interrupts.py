"""Ctrl-C where a test wants it: in place of a function, or in a report of progress."""


def ctrl_c(*_, **__):
    """Stands for any function, and is ended by Ctrl-C at once."""
    raise KeyboardInterrupt


def ctrl_c_when(holds):
    """Progress that Ctrl-C ends where `holds(text, done, count)`."""

    def progress(text, done, count):
        if holds(text, done, count):
            raise KeyboardInterrupt

    return progress


def ctrl_c_at_call(number):
    """Progress that Ctrl-C ends when it is called so many times."""
    told = []

    def progress(*step):
        told.append(step)
        if len(told) == number:
            raise KeyboardInterrupt

    return progress
