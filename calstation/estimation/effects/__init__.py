"""Tests for effects outside the error model, one added effect at a time (score tests)."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
