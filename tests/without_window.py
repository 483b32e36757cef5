"""Print the options that exclude the tests of the window for `make test` if Qt finds no system libraries."""

import sys

PACKAGES = "libglib2.0-0 libgl1 libegl1 libxkbcommon0 libfontconfig1 libdbus-1-3"

try:
    import PySide6.QtWidgets  # noqa: F401
except ImportError as error:
    sys.stderr.write(
        f"Qt cannot be used here ({error}): the window is not tested. On Debian: apt-get install {PACKAGES}\n"
    )
    sys.stdout.write("-p no:pytest-qt --ignore=tests/gui\n")
