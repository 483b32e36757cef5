"""A second opinion: an independent solution of a raw log, compared with its certificate, its DCC or its result.

The program imports numpy, scipy and h5py, and nothing of calstation, so that the folder may be copied and run alone. It
has its own mathematics: a stage is one least-squares problem of the trajectory and all parameters.
"""

from .verify import main
