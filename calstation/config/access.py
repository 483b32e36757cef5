"""The site's engineering PIN, which protects changes that affect results, and the engineers' personal PINs by badge.

The site's folder contains the salted hashes of the PINs. In all functions, the badge "" denotes the site's PIN.
"""

import hashlib
import hmac
import json
import os
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal
from urllib.parse import quote

from pydantic import Field

from calstation.config import library
from calstation.config.request import Confirmation, computer_user
from calstation.errors import ConfigurationError
from calstation.messages import os_reason
from calstation.parsing import read_json
from calstation.records import AuditEventName, append_audit, locked, write_atomic
from calstation.schema import StrictModel, validate

#: Minimum number of characters of a new PIN.
MIN_PIN_LENGTH = 6

#: Number of wrong PINs before the first delay.
_FREE_FAILURES = 2

#: Maximum delay after a wrong PIN, s; the first delay is one second, and each further delay is twice as long.
_MAX_DELAY = 300.0

#: Longest time to wait for another program that checks or sets a PIN, s.
_LOCK_TIMEOUT = 10.0

#: Cost of scrypt (RFC 7914) for new PINs, as recommended by the OWASP Password Storage Cheat Sheet of 2025: 32 MiB and
#: about 0.2 s. A stored PIN keeps the cost with which it was set.
_N, _R, _P = 2**15, 8, 3


class _Stored(StrictModel):
    """A PIN's hash with its salt and cost, and the number and last time of wrong PINs since the last correct PIN."""

    salt: str = Field(pattern="^[0-9a-f]{32}$")
    hash: str = Field(pattern="^[0-9a-f]{64}$")
    n: int = Field(gt=1)
    r: int = Field(gt=0)
    p: int = Field(gt=0)
    failures: int = Field(default=0, ge=0)
    failed_at: float = 0.0


def has_pin(badge: str = "") -> bool:
    """Return whether a PIN has been set; the first user sets the site's PIN."""
    return _file(badge).exists()


def set_pin(old: str, new: str, badge: str = "", author: Confirmation | None = None) -> None:
    """Set a new PIN after writing the audit trail to disk. Raises ConfigurationError.

    Parameters
    ----------
    old : current PIN, or the site's PIN if the badge has no PIN yet; ignored for the site's first PIN
    new : new PIN
    badge : badge of the engineer; "" for the site's PIN
    author : person who sets it, by default the user of this computer, and how the person was identified
    """
    if len(new) < MIN_PIN_LENGTH:
        raise ConfigurationError("access.pin_too_short", shortest=MIN_PIN_LENGTH)
    with _locked(badge):
        event: AuditEventName = "pin_changed" if has_pin(badge) else "pin_set"
        owner = badge if has_pin(badge) else ""  # badge to which the old PIN belongs
        if badge and not has_pin(owner):
            raise ConfigurationError("access.no_site_pin")
        if has_pin(owner) and not _check(old, owner):
            seconds = wait(owner)
            if seconds:
                raise ConfigurationError("access.wrong_pin_wait", seconds=seconds)
            raise ConfigurationError("access.wrong_pin")
        author = author or Confirmation(computer_user() or "engineer")
        details = {"badge": badge} if badge else {}
        append_audit(library.site_folder(), event, author.by, pin=author.pin, **details)
        salt = os.urandom(16)
        _store(_Stored(salt=salt.hex(), hash=_hash(new, salt, _N, _R, _P).hex(), n=_N, r=_R, p=_P), badge)


def check(pin: str, badge: str = "") -> bool:
    """Return whether `pin` is correct; False during the delay after wrong PINs. Raises ConfigurationError."""
    if not has_pin(badge):
        return False
    with _locked(badge):
        return _check(pin, badge)


def identify(pin: str, badge: str = "") -> Literal["personal", "site"] | None:
    """Return whether a PIN belongs to the badge or to the site; None if it belongs to neither, or during the delay.

    A PIN that belongs to neither counts as a wrong PIN of both. Raises ConfigurationError.
    """
    with _locked(badge):
        owner = _owner_of(pin, _owners(badge))
    return None if owner is None else "personal" if owner else "site"


def identify_wait(badge: str = "") -> float:
    """Return the time until the next PIN may be entered for `identify`, s."""
    return min(map(wait, _owners(badge)), default=0.0)


def _owners(badge: str) -> list[str]:
    """Return the badge and the site ("") if they have a PIN."""
    return [each for each in dict.fromkeys((badge, "")) if has_pin(each)]


def _check(pin: str, badge: str) -> bool:
    """Check a PIN while the PINs are locked, so that every concurrent attempt is counted."""
    return _owner_of(pin, [badge]) is not None


def _owner_of(pin: str, badges: Sequence[str]) -> str | None:
    """Return the badge to which a PIN belongs; if it belongs to none, count a wrong PIN of all that are not delayed."""
    stored = {badge: each for badge in badges if _wait(each := _load(badge)) <= 0.0}
    for badge, each in stored.items():
        digest = _hash(pin, bytes.fromhex(each.salt), each.n, each.r, each.p)
        if hmac.compare_digest(digest, bytes.fromhex(each.hash)):
            if each.failures:
                _store(each.model_copy(update={"failures": 0, "failed_at": 0.0}), badge)
            return badge
    for badge, each in stored.items():
        _store(each.model_copy(update={"failures": each.failures + 1, "failed_at": time.time()}), badge)
    return None


def wait(badge: str = "") -> float:
    """Return the time until the next PIN may be entered, s; it persists over a restart of the program."""
    return _wait(_load(badge)) if has_pin(badge) else 0.0


def _wait(stored: _Stored) -> float:
    if stored.failures <= _FREE_FAILURES:
        return 0.0
    delay = min(2.0 ** min(stored.failures - _FREE_FAILURES - 1, 30), _MAX_DELAY)
    remaining = stored.failed_at + delay - time.time()
    return min(max(0.0, remaining), delay)  # a clock that was set back causes at most one delay


def _hash(pin: str, salt: bytes, n: int, r: int, p: int) -> bytes:
    return hashlib.scrypt(pin.encode(), salt=salt, n=n, r=r, p=p, maxmem=2**28, dklen=32)


@contextmanager
def _locked(badge: str) -> Iterator[None]:
    """Lock the PINs of the site while the context is open. Raises ConfigurationError."""
    folder = library.site_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with locked(folder / ".pin.lock", _LOCK_TIMEOUT):
            yield
    except OSError as exc:
        raise ConfigurationError("configuration.unwritable", file=_file(badge), reason=os_reason(exc)) from exc


def _file(badge: str) -> Path:
    folder = library.site_folder()
    return folder / "engineers" / f"{quote(badge, safe='')}.json" if badge else folder / "engineer.json"


def _load(badge: str) -> _Stored:
    path = _file(badge)
    try:
        data: Any = read_json(path)
    except (OSError, ValueError) as exc:
        raise ConfigurationError("access.pin_unreadable", file=path, detail=str(exc)) from exc
    return validate(_Stored, data, path)


def _store(stored: _Stored, badge: str) -> None:
    """Store a PIN. Raises OSError."""
    path = _file(badge)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(path, json.dumps(stored.model_dump()) + "\n", mode=0o600)
