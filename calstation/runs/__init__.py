"""The engine process and the life of a run: start, resume, finalise, recover at start-up.

Steps and motion belong to `sequencer`; simulation hooks in from outside.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
