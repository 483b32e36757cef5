"""What all solvers share: samples, rests, noise, alignment, least squares; no method of its own."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
