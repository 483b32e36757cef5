"""Translated texts of the window: catalogue sentences, check texts and language bindings; no widget classes."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
