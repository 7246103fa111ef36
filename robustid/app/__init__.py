"""From a run file or the command line to results: what users start."""
