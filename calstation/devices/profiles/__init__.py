"""Data models of profile files: frames, registers, limits and accuracy, validated as a whole.

The files are found and edited by `config`.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
