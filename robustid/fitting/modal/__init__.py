"""Modes of a model and fits in modal form."""
