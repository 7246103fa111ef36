"""One run: the description of its steps, the reading of its data, and its execution."""
