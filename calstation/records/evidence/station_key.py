"""The key with which a station signs the lines of its audit trail and of its reports (Ed25519, RFC 8032).

By default the private key is the file ``station.key`` in the site's folder, which only its owner may read. The head of
the audit trail, signed with the key, is in the file ``station.head`` next to it.
"""

import json
import os
import re
import stat
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from calstation.errors import ConfigurationError, InputError
from calstation.messages import os_reason
from calstation.records.files import sync_folder, write_atomic

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

#: Environment variable with the path of the private key, for a site that keeps it outside its folder.
KEY_VARIABLE = "CALSTATION_STATION_KEY"
_FILE = "station.key"
#: File in the folder of runs with the heads of audit trails in the shared database; the history ignores hidden files.
_DATABASE_HEADS = ".trail_heads.json"
_HEAD = re.compile(rb"calstation-trail:(\d{1,9}):([0-9a-f]{64}):([0-9a-f]{64}|-)")


@dataclass(frozen=True)
class TrailHead:
    """The last line of an audit trail at some time; every later state of the trail contains this line."""

    #: Public key in hexadecimal digits, which identifies the trail; "" before the first signed line.
    key: str
    lines: int  #: Number of lines.
    digest: str  #: Digest of the last line.

    def __str__(self) -> str:
        """Return the text printed in certificates, for which `find_heads` searches."""
        return f"calstation-trail:{self.lines}:{self.digest}:{self.key or '-'}"


def find_heads(content: bytes) -> list[TrailHead]:
    """Return the heads of audit trails stated in a certificate, a PDF or an XML document, without repetitions."""
    matches = dict.fromkeys(_HEAD.findall(content))
    return [TrailHead("" if key == b"-" else key.decode(), int(n), digest.decode()) for n, digest, key in matches]


@dataclass(frozen=True)
class DatabaseHead:
    """A head of an audit trail that the shared database has, and the name of the station that sent it."""

    head: TrailHead
    station: str


def database_heads(runs: Path) -> list[DatabaseHead]:
    """Return the heads that the last exchange of a runs folder received from the shared database.

    Raises InputError if the file cannot be read.
    """
    path = runs / _DATABASE_HEADS
    try:
        return [DatabaseHead(read_head(row["head"]), str(row["station"])) for row in json.loads(path.read_bytes())]
    except FileNotFoundError:
        return []
    except OSError as exc:
        raise InputError("result.unreadable", file=path, reason=os_reason(exc)) from exc
    except (ValueError, KeyError, TypeError) as exc:
        raise InputError("audit.database_heads_damaged", file=path) from exc


def store_database_heads(runs: Path, heads: Iterable[DatabaseHead]) -> None:
    """Replace the heads that `database_heads` returns. Raises OSError."""
    content = json.dumps([asdict(each) for each in heads]).encode() + b"\n"
    path = runs / _DATABASE_HEADS
    if not path.exists() or path.read_bytes() != content:
        write_atomic(path, content)


class StationKey:
    """A private key."""

    def __init__(self, private: "Ed25519PrivateKey") -> None:
        self._private = private
        self.public = private.public_key().public_bytes_raw().hex()  #: Public key in hexadecimal digits.

    def sign(self, message: bytes) -> str:
        """Return the signature of a message in hexadecimal digits."""
        return self._private.sign(message).hex()


def key_file(folder: Path) -> Path:
    """Return the file of the private key of a site."""
    stated = os.environ.get(KEY_VARIABLE)
    return Path(stated) if stated else folder / _FILE


def head_file(folder: Path) -> Path:
    """Return the file with the signed head of the audit trail of a site."""
    return key_file(folder).with_suffix(".head")


def load_key(folder: Path, recorded: str | None = None) -> tuple[StationKey | None, bool]:
    """Return the key of a site, or None if there is none, and whether the creation of the key was interrupted.

    `recorded` is the public key in the audit trail. If the program was ended after the trail had recorded a new key,
    `finish_key` must replace the earlier one. Raises ConfigurationError if a file cannot be read.
    """
    pending = _load(_pending(folder)) if recorded is not None else None
    if pending is not None and pending.public == recorded:
        return pending, True
    return _load(key_file(folder)), False


def _load(path: Path) -> StationKey | None:
    from cryptography.exceptions import UnsupportedAlgorithm
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    try:
        key = load_pem_private_key(path.read_bytes(), None)
    except FileNotFoundError:
        return None
    except OSError as exc:
        raise ConfigurationError("audit.key_unreadable", file=path, reason=os_reason(exc)) from exc
    except (ValueError, TypeError, UnsupportedAlgorithm) as exc:
        raise ConfigurationError("audit.key_damaged", file=path) from exc
    if not isinstance(key, Ed25519PrivateKey):
        raise ConfigurationError("audit.key_damaged", file=path)
    return StationKey(key)


def new_key(folder: Path) -> StationKey:
    """Create a key, which becomes the key of the site by `finish_key` after the trail has recorded it. Raises OSError.

    Only the owner may read the first key of a site; a later one has the permissions of the key that it replaces.
    """
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat

    private = Ed25519PrivateKey.generate()
    path = _pending(folder)
    path.parent.mkdir(parents=True, exist_ok=True)
    content = private.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    former = key_file(folder)
    mode = stat.S_IMODE(former.stat().st_mode) if former.exists() else 0o600
    write_atomic(path, content, mode)
    return StationKey(private)


def finish_key(folder: Path) -> None:
    """Replace the key of a site by the new one. Raises OSError."""
    _pending(folder).replace(key_file(folder))
    sync_folder(key_file(folder).parent)


def _pending(folder: Path) -> Path:
    return key_file(folder).with_suffix(".new")


def store_head(folder: Path, key: StationKey, head: TrailHead) -> None:
    """Store the signed head of the audit trail of a site. Raises OSError."""
    content = {**asdict(head), "signature": key.sign(_message(head))}
    write_atomic(head_file(folder), json.dumps(content) + "\n")


def load_head(folder: Path) -> TrailHead | None:
    """Return the stored head of the audit trail of a site, whose signature is valid; None if there is no file.

    Raises ValueError if it was changed, or OSError.
    """
    try:
        content = json.loads(head_file(folder).read_bytes())
    except FileNotFoundError:
        return None
    try:
        signature = str(content.pop("signature"))
        head = read_head(content)
    except (AttributeError, KeyError, TypeError) as exc:
        raise ValueError("not a head") from exc
    if not is_signed(head.key, _message(head), signature):
        raise ValueError("wrong signature")
    return head


def read_head(content: Mapping[str, object]) -> TrailHead:
    """Return a head given as JSON data. Raises KeyError, TypeError or ValueError if the data are not a head."""
    head = TrailHead(str(content["key"]), int(str(content["lines"])), str(content["digest"]))
    if head.lines < 1 or {"key": head.key, "lines": head.lines, "digest": head.digest} != content:
        raise ValueError("not a head")
    return head


def _message(head: TrailHead) -> bytes:
    return json.dumps(asdict(head)).encode()


def is_signed(key: str, message: bytes, signature: str) -> bool:
    """Return whether a signature of a message is valid; `key` is the public key. Both are hexadecimal digits."""
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

    with suppress(InvalidSignature, ValueError):
        Ed25519PublicKey.from_public_bytes(bytes.fromhex(key)).verify(bytes.fromhex(signature), message)
        return True
    return False
