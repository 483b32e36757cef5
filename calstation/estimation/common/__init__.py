"""Code that all solvers share: samples, rests, noise, alignment and least squares."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
