"""Fits of time records."""
