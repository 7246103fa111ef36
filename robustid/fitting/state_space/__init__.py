"""State-space models and pole movers behind the fits."""
