"""The modules of SciPy whose types are stated beside this file; all others keep their own."""
