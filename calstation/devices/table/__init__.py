"""Drivers of tables: Modbus registers, text commands, an indexing unit, a manual rig.

They execute commands; limits are checked before them.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
