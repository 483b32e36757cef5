"""Functions compiled by numba, whose cached code is discarded when any of their sources changes.

numba compares cached code with the file of its function only, but that code also contains the functions that it calls,
which may be in other files.
"""

import os
from collections.abc import Callable
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar, cast

import numba as nb

F = TypeVar("F", bound=Callable[..., Any])
#: Packages whose kernels call each other.
_PACKAGES = ("physics", "estimation", "judgement")
_MARK = "kernel_sources"


def kernel(function: F) -> F:
    """Compile a function when it is first called, or load it from the cache; the compiled code releases the GIL.

    The cache is next to the source or, in a read-only installation, in the user's cache folder; without
    either, every process compiles again.
    """
    try:
        return cast(F, nb.njit(cache=True, nogil=True)(function))
    except RuntimeError:  # no folder for the cache can be written
        return cast(F, nb.njit(nogil=True)(function))


def discard_outdated(root: Path) -> None:
    """Delete the cached code of a package if the source of a kernel has changed since the last call.

    Nothing happens in a folder that cannot be written; an installer replaces all of its files.
    """
    folders = [root / package for package in _PACKAGES]
    sources = sorted(
        path for folder in folders for path in folder.rglob("*.py") if "@kernel" in path.read_text("utf-8")
    )
    current = sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()
    mark = root / "__pycache__" / _MARK
    with suppress(OSError):
        if mark.is_file() and mark.read_text("ascii") == current:
            return
        for folder in folders:
            for index in folder.rglob("*.nbi"):
                index.unlink(missing_ok=True)
        mark.parent.mkdir(exist_ok=True)
        temporary = mark.with_name(f"{_MARK}.{os.getpid()}")
        temporary.write_text(current, "ascii")
        temporary.replace(mark)


discard_outdated(Path(__file__).parents[1])
