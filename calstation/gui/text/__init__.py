"""Texts in the language of the window: catalogue sentences, checks, bindings to the language; no widgets."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
