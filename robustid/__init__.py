"""Models with a proof: robust identification of lightly damped machines from time and frequency data."""

import lazy_loader

# The public names stand in __init__.pyi, by room; each is loaded on first use.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
