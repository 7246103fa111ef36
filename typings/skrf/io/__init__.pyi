"""The modules of scikit-rf whose types are stated beside this file."""
