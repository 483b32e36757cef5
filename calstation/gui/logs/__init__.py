"""The Offline page: plots one log and solves it again by its stages or a method; `results` computes."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
