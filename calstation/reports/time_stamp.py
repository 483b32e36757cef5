"""RFC 3161 time stamps of the head of the audit trail: an authority confirms that the trail existed at a time.

A time stamp contains only the digest of the head, as a certificate states it, so that the authority learns nothing.
"""

import asyncio
import hashlib
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

from calstation.config import site_folder
from calstation.errors import ConfigurationError, InputError
from calstation.messages import Text, os_reason
from calstation.records import AuditTrail, TrailHead, public_key, site_trails, verify_trail, write_atomic
from calstation.reports.verification import CertificateState

#: Longest time to wait for the authority, s.
_TIMEOUT = 30


def stamp_trail(url: str) -> Path:
    """Have an authority stamp the head of the site's audit trail; return the file, which is in the site's folder.

    Raises ConfigurationError if the extra ``signing`` is not installed, if the trail was changed or is empty, if the
    authority refuses, or if the file cannot be written.
    """
    try:
        from pyhanko.sign.timestamps import HTTPTimeStamper, TimestampRequestError
    except ImportError as exc:
        raise ConfigurationError("signing.not_installed") from exc
    state = verify_trail(site_folder())
    state.require_intact()
    if state.head is None:
        raise ConfigurationError("audit.nothing_to_stamp", file=state.path)
    path = site_folder() / f"audit_line_{state.head.lines}.tst"
    try:
        digest = _digest(state.head)
        token = asyncio.run(HTTPTimeStamper(url, timeout=_TIMEOUT).async_timestamp(digest, "sha256"))
        if _stamped(token["content"])["message_imprint"]["hashed_message"].native != digest:
            raise ValueError("the answer is about another digest")
        write_atomic(path, token.dump())
    except (TimestampRequestError, ValueError, TypeError) as exc:
        raise ConfigurationError("audit.not_stamped", url=url, reason=str(exc.__cause__ or exc)) from exc
    except OSError as exc:
        raise ConfigurationError("result.unwritable", file=path, reason=os_reason(exc)) from exc
    return path


def verify_time_stamp(path: Path) -> CertificateState:
    """Verify a time stamp, and find its line in the audit trails of the site.

    Whether the authority can be trusted is for the reader to decide. Raises InputError if a file cannot be read, or
    ConfigurationError if the extra ``signing`` is not installed.
    """
    try:
        from asn1crypto import cms
        from pyhanko.sign.validation.generic_cms import validate_tst_signed_data
        from pyhanko_certvalidator import ValidationContext
    except ImportError as exc:
        raise ConfigurationError("signing.not_installed") from exc
    try:
        signed = cms.ContentInfo.load(path.read_bytes(), strict=True)["content"]
        info = _stamped(signed)
        imprint, time = info["message_imprint"]["hashed_message"].native, info["gen_time"].native
        roots = [each.chosen for each in signed["certificates"]]
        status = asyncio.run(validate_tst_signed_data(signed, ValidationContext(trust_roots=roots), lambda _: imprint))
    except OSError as exc:
        raise InputError("result.unreadable", file=path, reason=os_reason(exc)) from exc
    except Exception as exc:  # the parsers of other packages raise errors of many kinds for a damaged file
        raise InputError("audit.stamp_damaged", file=path) from exc
    if not (status["intact"] and status["valid"]):
        raise InputError("audit.stamp_damaged", file=path)
    values = {"file": path, "authority": status["signing_cert"].subject.human_friendly, "time": _text(time)}
    for trail_file, trail in site_trails(site_folder()):
        head = next((head for head in _heads(trail) if _digest(head) == imprint), None)
        if head is not None:
            stamped = {**values, "trail": trail_file, "line": head.lines, "digest": head.digest}
            return CertificateState((Text.of("audit.stamped", **stamped),), intact=trail.damage is None)
    return CertificateState((Text.of("audit.stamp_of_other", **values),), intact=False)


def _stamped(signed: Any) -> Any:
    """Return the `TSTInfo` that an authority has signed (RFC 3161, 2.4.2)."""
    return signed["encap_content_info"]["content"].parsed


def _heads(trail: AuditTrail) -> Iterator[TrailHead]:
    for key in {public_key(trail) or "", ""}:
        yield from (TrailHead(key, number, digest) for number, digest in enumerate(trail.digests, 1))


def _digest(head: TrailHead) -> bytes:
    return hashlib.sha256(str(head).encode()).digest()


def _text(time: Any) -> str:
    return time.isoformat(timespec="seconds") if isinstance(time, datetime) else str(time)
