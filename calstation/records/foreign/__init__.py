"""Recordings in the file formats of other programs: one module per format, and one entry in `FOREIGN_FORMATS`.

A module lists the topics of a file and reads the columns of one as arrays; the rest is common to all recordings. It
does not write, and imports the library of its format only to read a file.
"""

from calstation.records.foreign.opening import FOREIGN_FORMATS, foreign_format, open_foreign
from calstation.records.foreign.topics import ForeignFormat, Topic
