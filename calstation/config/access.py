"""The engineer's PIN: kept as a salted hash in the site's folder, asked for before what changes results is enabled."""

import hashlib
import hmac
import json
import os
import time
from pathlib import Path
from typing import Any

from pydantic import Field

from calstation.config import library
from calstation.errors import ConfigurationError
from calstation.records.atomic import write_atomic
from calstation.schema import StrictModel, validate

#: Fewest characters of a PIN.
SHORTEST = 4

#: Wrong PINs before the first delay.
_FREE_FAILURES = 2

#: s; the delays double from one second up to here.
_LONGEST_DELAY = 300.0

#: Work of scrypt (RFC 7914): 8 MiB and some 20 ms, which a window may spend on a key stroke.
_N, _R, _P = 2**13, 8, 1


class _Stored(StrictModel):
    """The file: hash with its salt and work, wrong PINs since the last right one, when the last of them came."""

    salt: str = Field(pattern="^[0-9a-f]{32}$")
    hash: str = Field(pattern="^[0-9a-f]{64}$")
    n: int = Field(gt=1)
    r: int = Field(gt=0)
    p: int = Field(gt=0)
    failures: int = Field(default=0, ge=0)
    failed_at: float = 0.0


def has_pin() -> bool:
    """Whether a PIN has been set; without one the engineer's role is open to whoever sets the first."""
    return _file().exists()


def set_pin(old: str, new: str) -> None:
    """Set a new PIN; `old` counts only where there is one.

    Raises ConfigurationError where `old` is wrong or must wait, `new` is too short or cannot be stored.
    """
    if len(new) < SHORTEST:
        raise ConfigurationError(f"PIN: too short; give at least {SHORTEST} characters")
    if has_pin() and not check(old):
        seconds = wait()
        raise ConfigurationError(
            "PIN: the old one is wrong"
            + (f"; wait {seconds:.0f} s and try again" if seconds else "; try again")
        )
    salt = os.urandom(16)
    _store(_Stored(salt=salt.hex(), hash=_hash(new, salt, _N, _R, _P).hex(), n=_N, r=_R, p=_P))


def check(pin: str) -> bool:
    """Whether `pin` is the engineer's. A wrong one counts; while `wait` lasts none is right.

    Raises ConfigurationError where the stored PIN cannot be read.
    """
    if not has_pin():
        return False
    stored = _load()
    if _wait(stored) > 0.0:
        return False
    found = _hash(pin, bytes.fromhex(stored.salt), stored.n, stored.r, stored.p)
    right = hmac.compare_digest(found, bytes.fromhex(stored.hash))
    if right and stored.failures:
        _store(stored.model_copy(update={"failures": 0, "failed_at": 0.0}))
    elif not right:
        _store(stored.model_copy(update={"failures": stored.failures + 1, "failed_at": time.time()}))
    return right


def wait() -> float:
    """Seconds until the next PIN may be tried, 0 where at once. Outlives the program."""
    return _wait(_load()) if has_pin() else 0.0


def _wait(stored: _Stored) -> float:
    if stored.failures <= _FREE_FAILURES:
        return 0.0
    delay = min(2.0 ** min(stored.failures - _FREE_FAILURES - 1, 30), _LONGEST_DELAY)
    left = stored.failed_at + delay - time.time()
    return min(max(0.0, left), delay)  # a clock that was put back costs one delay, not a day


def _hash(pin: str, salt: bytes, n: int, r: int, p: int) -> bytes:
    return hashlib.scrypt(pin.encode(), salt=salt, n=n, r=r, p=p, maxmem=2**27, dklen=32)


def _file() -> Path:
    return library.site_folder() / "engineer.json"


def _load() -> _Stored:
    path = _file()
    try:
        data: Any = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as exc:
        raise ConfigurationError(f"{path}: cannot be read ({exc}); remove it to set a new PIN") from exc
    return validate(_Stored, data, path)


def _store(stored: _Stored) -> None:
    path = _file()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, json.dumps(stored.model_dump()) + "\n", mode=0o600)
    except OSError as exc:
        raise ConfigurationError(
            f"{path}: cannot be written ({exc.strerror or exc}); make the site's folder writable"
        ) from exc
