"""The engine process and the life cycle of a run: start, resume, finalize, start-up recovery.

Steps and motion are in `sequencer`; simulations use `RunHooks`.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
