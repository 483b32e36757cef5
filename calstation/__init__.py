"""calstation: calibrates inertial measurement units on a two-axis rate table."""

import logging
from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("calstation")
except PackageNotFoundError:  # run from a source tree that was never installed
    __version__ = "0+source"

# Programs that use the package without configuring its application log get no log output.
logging.getLogger(__name__).addHandler(logging.NullHandler())
