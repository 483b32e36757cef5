"""The message catalogue: every error, event, finding and term that a person reads, in English and Chinese.

Code elsewhere handles codes and values and never a sentence. Nothing here knows Qt, devices or files of a run.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
