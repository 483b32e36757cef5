"""Export of calibrations to other programs, each checked with the formula of the program that reads it.

A format is a module that writes and evaluates its files, and one entry in `FORMATS`. `records` exports recordings.
"""

from calstation.exports.check import ExportCheck
from calstation.exports.export import export_calibration
from calstation.exports.formats import FORMATS
from calstation.exports.source import ExportSource
