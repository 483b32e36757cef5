"""The models of profile files: frames, registers, limits and accuracy, checked as a whole.

Finding and editing the files belongs to `config`.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
