"""Tools for other programs, by the Model Context Protocol: commands in processes of their own, over stdin and stdout."""
