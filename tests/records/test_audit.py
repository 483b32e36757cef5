"""The audit trail is a signed hash chain that reveals later changes and survives a process killed while writing."""

import hashlib
import json
import multiprocessing
import os
import re
import stat
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from calstation.errors import ConfigurationError, InputError
from calstation.records import (
    ChainedFile,
    append_audit,
    audit_path,
    database_contradictions,
    files,
    intact_trail,
    read_audit,
    restart_trail,
    site_events,
    verify_trail,
)
from calstation.records.evidence import audit, reports
from calstation.records.evidence.station_key import (
    DatabaseHead,
    StationKey,
    head_file,
    key_file,
    store_database_heads,
    store_head,
)
from tests.helpers import raises_code


@pytest.fixture
def trail(tmp_path: Path) -> Path:
    append_audit(tmp_path, "pin_set", "wang")
    append_audit(tmp_path, "file_saved", "李", "new limits", kind="products", name="nav_a", version=2)
    why = 'scratch, "accepted"\n'
    append_audit(tmp_path, "override", "wang", why, confirmed_by="li", serial="SN-1", limit=1.5e-7)
    return audit_path(tmp_path)


def first_bad(trail: Path) -> int | None:
    """Return the number of the first damaged line."""
    damage = read_audit(trail).damage
    return damage and damage.number


def test_event_is_read_as_written(trail: Path) -> None:
    chain = read_audit(trail)
    assert (chain.damage, chain.incomplete, len(chain.entries)) == (None, (), 3)
    last = chain.entries[-1]
    assert (last.event, last.by, last.confirmed_by, last.why) == ("override", "wang", "li", 'scratch, "accepted"\n')
    assert last.values == {"serial": "SN-1", "limit": 1.5e-7}
    assert chain.digest == last.digest


def test_digest_is_the_sha_256_of_the_rest_of_the_line(trail: Path) -> None:
    previous = "0" * 64
    for line in trail.read_text("utf-8").splitlines():
        rest = re.sub(r', "digest": "[0-9a-f]{64}"\}$', "}", line)
        assert json.loads(rest)["previous"] == previous
        previous = json.loads(line)["digest"]
        assert previous == hashlib.sha256(rest.encode()).hexdigest()


def test_missing_trail_is_empty(tmp_path: Path) -> None:
    assert read_audit(audit_path(tmp_path)).entries == ()


@pytest.mark.parametrize("line", [0, 1, 2])
def test_change_of_any_line_is_detected(trail: Path, line: int) -> None:
    lines = trail.read_bytes().splitlines(keepends=True)
    for i in range(len(lines[line]) - 1):
        changed = bytearray(lines[line])
        changed[i] ^= 1
        trail.write_bytes(b"".join([*lines[:line], bytes(changed), *lines[line + 1 :]]))
        assert first_bad(trail) == line + 1


def test_removed_or_moved_line_is_detected_at_the_next_line(trail: Path) -> None:
    one, two, three = trail.read_bytes().splitlines(keepends=True)
    for lines, bad in (([two, three], 1), ([one, three], 2), ([one, three, two], 2), ([one, one, two, three], 2)):
        trail.write_bytes(b"".join(lines))
        assert first_bad(trail) == bad


def test_line_with_a_recomputed_digest_has_a_wrong_signature(tmp_path: Path, trail: Path) -> None:
    lines = trail.read_text("utf-8").splitlines(keepends=True)
    rest = re.sub(r', "digest": "[0-9a-f]{64}"\}\n$', "}", lines[1]).replace("new limits", "none")
    digest = hashlib.sha256(rest.encode()).hexdigest()
    lines[1] = f'{rest[:-1]}, "digest": "{digest}"}}\n'
    trail.write_text("".join(lines), encoding="utf-8")
    assert first_bad(trail) == 2


def test_truncated_line_is_reported_and_the_chain_continues_after_it(tmp_path: Path, trail: Path) -> None:
    head = head_file(tmp_path).read_bytes()
    append_audit(tmp_path, "pin_set", "li")
    whole = trail.read_bytes()
    start = whole.rstrip(b"\n").rindex(b"\n") + 1
    for end in range(start + 1, len(whole) - 1, 7):
        trail.write_bytes(whole[:end])
        head_file(tmp_path).write_bytes(head)  # it is written after the line
        assert (read_audit(trail).incomplete, first_bad(trail)) == ((4,), None)
        append_audit(tmp_path, "pin_changed", "li")
        chain = read_audit(trail)
        assert (chain.incomplete, chain.damage) == ((4,), None)
        assert [each.event for each in chain.entries] == ["pin_set", "file_saved", "override", "pin_changed"]
        assert trail.read_bytes().startswith(whole[:end])


def _drop(trail: Path, lines: int) -> None:
    trail.write_bytes(b"".join(trail.read_bytes().splitlines(keepends=True)[:-lines]))


def _forge(trail: Path) -> None:
    """Append a line with a correct chain, as the program did before lines were signed."""
    ChainedFile[object](trail, object).append(
        {"utc": "", "event": "pin_set", "by": "x", "confirmed_by": None, "why": "", "values": {}}
    )


def _own_key(trail: Path) -> None:
    """Write the whole trail anew with another key."""
    lines = [json.loads(line) for line in trail.read_bytes().splitlines()]
    trail.unlink()
    other = StationKey(Ed25519PrivateKey.generate())
    for line in lines:
        content = {name: value for name, value in line.items() if name not in ("signature", "previous", "digest")}
        content |= {"key": other.public} if "key" in line else {}
        ChainedFile[object](trail, object).append(content, other.sign)


def _without_signatures(trail: Path) -> None:
    lines = [json.loads(line) for line in trail.read_bytes().splitlines()]
    trail.unlink()
    for line in lines:
        names = ("key", "signature", "previous", "digest")
        ChainedFile[object](trail, object).append({name: line[name] for name in line if name not in names})


#: What somebody who can write the folder, but not read the key, does to it.
TAMPERING: dict[str, Callable[[Path], object]] = {
    "last line removed": lambda trail: _drop(trail, 1),
    "last lines removed": lambda trail: _drop(trail, 2),
    "emptied": lambda trail: trail.write_bytes(b""),
    "removed": lambda trail: trail.unlink(),
    "unsigned line appended": _forge,
    "written anew with another key": _own_key,
    "written anew without signatures": _without_signatures,
    "key removed": lambda trail: key_file(trail.parent).unlink(),
    "head removed": lambda trail: head_file(trail.parent).unlink(),
    "head changed": lambda trail: head_file(trail.parent).write_bytes(
        head_file(trail.parent).read_bytes().replace(b'"lines": 3', b'"lines": 2')
    ),
    "trail and head removed": lambda trail: (trail.unlink(), head_file(trail.parent).unlink()),
}


@pytest.mark.parametrize("kind", TAMPERING)
def test_nothing_is_appended_to_a_changed_trail_until_it_is_restarted(tmp_path: Path, trail: Path, kind: str) -> None:
    TAMPERING[kind](trail)
    before = trail.read_bytes() if trail.exists() else None
    assert verify_trail(tmp_path).faults
    assert verify_trail(tmp_path, every_signature=True).faults
    with raises_code(ConfigurationError, "audit.broken"):
        append_audit(tmp_path, "pin_changed", "li")
    assert (trail.read_bytes() if trail.exists() else None) == before
    event = restart_trail(tmp_path, "li", "disk repaired", None)
    assert (event.event, event.by, event.why, len(event.values["faults"]) > 0) == (
        "trail_restarted", "li", "disk repaired", True,
    )  # fmt: skip
    if before is not None:
        assert (tmp_path / str(event.values["file"])).read_bytes() == before
    append_audit(tmp_path, "pin_changed", "li")
    assert not verify_trail(tmp_path, every_signature=True).faults
    assert [each.event for each in read_audit(trail).entries] == ["trail_restarted", "pin_changed"]


def test_every_byte_of_key_and_head_is_covered(tmp_path: Path, trail: Path) -> None:
    for path in (key_file(tmp_path), head_file(tmp_path)):
        content = path.read_bytes()
        for i in range(0, len(content) - 1, 5):
            changed = bytearray(content)
            changed[i] ^= 4
            path.write_bytes(bytes(changed))
            state = verify_trail(tmp_path)
            assert state.faults or state.key_error is not None
        path.write_bytes(content)
    assert not verify_trail(tmp_path).faults


def test_events_before_the_change_remain_known_after_a_restart(tmp_path: Path, trail: Path) -> None:
    _forge(trail)
    restart_trail(tmp_path, "li", "forged", None)
    assert [each.event for each in site_events(tmp_path)] == ["pin_set", "file_saved", "override", "trail_restarted"]


def test_lines_older_than_the_key_are_accepted_only_before_it(tmp_path: Path) -> None:
    trail = audit_path(tmp_path)
    _forge(trail)
    _forge(trail)
    assert not verify_trail(tmp_path).faults
    append_audit(tmp_path, "pin_changed", "li")
    assert not verify_trail(tmp_path).faults
    assert [each.key is not None for each in read_audit(trail).entries] == [False, False, True]
    _forge(trail)
    assert first_bad(trail) == 4


@pytest.mark.skipif(sys.platform == "win32", reason="no such permissions")
def test_only_the_owner_may_read_the_key(tmp_path: Path, trail: Path) -> None:
    assert stat.S_IMODE(key_file(tmp_path).stat().st_mode) == 0o600


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no umask")
def test_several_accounts_append_to_one_trail(tmp_path: Path) -> None:
    """The umask of the accounts decides who may write the files, and a new key is readable for whom the former was."""
    before = os.umask(0o002)
    try:
        append_audit(tmp_path, "pin_set", "wang")
        key_file(tmp_path).chmod(0o640)
        restart_trail(tmp_path, "li", "disk replaced", None)
    finally:
        os.umask(before)
    modes = {path.name: stat.S_IMODE(path.stat().st_mode) for path in tmp_path.iterdir()}
    assert modes.pop("station.key") == 0o640
    assert {*modes.values()} == {0o664}


def test_unreadable_head_is_no_missing_file(tmp_path: Path, trail: Path) -> None:
    """An account without rights in the folder of the key learns which rights it lacks."""
    head_file(tmp_path).unlink()
    head_file(tmp_path).mkdir()
    with raises_code(InputError, "audit.head_unreadable"):
        verify_trail(tmp_path)
    with raises_code(ConfigurationError, "audit.head_unreadable"):
        append_audit(tmp_path, "pin_set", "wang")


def test_site_chooses_where_the_key_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CALSTATION_STATION_KEY", str(tmp_path / "safe" / "line1.key"))
    append_audit(tmp_path / "site", "pin_set", "wang")
    append_audit(tmp_path / "site", "pin_changed", "wang")
    assert {path.name for path in (tmp_path / "safe").iterdir()} == {"line1.key", "line1.head"}
    assert not verify_trail(tmp_path / "site").faults


@pytest.mark.parametrize("step", ["store_head", "finish_key"])
@pytest.mark.parametrize("begin", ["first", "restart"])
def test_key_whose_creation_was_interrupted_is_finished(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: str, begin: str
) -> None:
    def killed(*arguments: object) -> None:
        raise KeyboardInterrupt

    if begin == "restart":
        append_audit(tmp_path, "pin_set", "wang")
        audit_path(tmp_path).unlink()
    monkeypatch.setattr(audit, step, killed)
    with pytest.raises(KeyboardInterrupt):
        restart_trail(tmp_path, "li", "lost", None) if begin == "restart" else append_audit(tmp_path, "pin_set", "wang")
    monkeypatch.undo()
    assert not verify_trail(tmp_path).faults
    append_audit(tmp_path, "pin_changed", "li")
    assert not verify_trail(tmp_path).faults
    assert len(read_audit(audit_path(tmp_path)).entries) == 2


def test_event_that_could_not_be_read_back_is_not_written(tmp_path: Path, trail: Path) -> None:
    whole = trail.read_bytes()
    for value in (float("nan"), float("inf")):
        with pytest.raises(ValueError, match="values"):
            append_audit(tmp_path, "override", "li", "scratch", limit=value)
    assert trail.read_bytes() == whole


def test_line_without_its_newline_is_complete(tmp_path: Path, trail: Path) -> None:
    trail.write_bytes(trail.read_bytes()[:-1])
    append_audit(tmp_path, "pin_changed", "li")
    chain = read_audit(trail)
    assert (chain.incomplete, chain.damage, len(chain.entries)) == ((), None, 4)


@pytest.mark.parametrize("length", [0, 1, 40, -1])
def test_head_stays_in_the_trail_after_an_interrupted_line_is_closed(tmp_path: Path, trail: Path, length: int) -> None:
    whole = trail.read_bytes()
    append_audit(tmp_path, "pin_set", "wang")
    line = trail.read_bytes()[len(whole) :]
    head_file(tmp_path).unlink()
    state = verify_trail(tmp_path)
    assert state.key is not None
    assert state.head is not None
    store_head(tmp_path, state.key, replace(state.head, lines=3, digest=state.trail.digests[2]))
    trail.write_bytes(whole + line[:length])
    state = verify_trail(tmp_path)
    head = state.head
    assert state.faults == ()
    assert head is not None
    append_audit(tmp_path, "pin_set", "li")
    assert database_contradictions(verify_trail(tmp_path), [DatabaseHead(head, "station")]) == []


def test_events_of_an_intact_trail_are_read_without_verifying_every_signature(
    tmp_path: Path, trail: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    verified = []
    original = audit.is_signed
    monkeypatch.setattr(audit, "is_signed", lambda *line: verified.append(line) or original(*line))
    assert (len(site_events(tmp_path)), verified) == (3, [])
    head_file(tmp_path).unlink()
    assert (len(site_events(tmp_path)), len(verified) >= 3) == (3, True)


def test_an_event_appended_between_two_readings_is_no_change(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    append_audit(tmp_path, "pin_set", "wang")
    earlier = [verify_trail(tmp_path)]
    append_audit(tmp_path, "pin_set", "li")
    head = verify_trail(tmp_path).head
    assert head is not None
    store_database_heads(tmp_path, [DatabaseHead(head, "station")])
    monkeypatch.setattr(reports, "verify_trail", lambda folder: earlier.pop() if earlier else verify_trail(folder))
    assert intact_trail(tmp_path, tmp_path).head == head
    audit_path(tmp_path).write_bytes(audit_path(tmp_path).read_bytes().replace(b'"li"', b'"lu"'))
    with raises_code(ConfigurationError, "audit.broken"):
        intact_trail(tmp_path, tmp_path)


def test_modified_last_line_is_not_treated_as_incomplete(tmp_path: Path, trail: Path) -> None:
    trail.write_bytes(trail.read_bytes()[:-1].replace(b"SN-1", b"SN-2"))
    assert first_bad(trail) == 3


def test_change_of_an_incomplete_line_is_detected(tmp_path: Path, trail: Path) -> None:
    head = head_file(tmp_path).read_bytes()
    append_audit(tmp_path, "override", "wang", serial="SN-1")
    trail.write_bytes(trail.read_bytes()[:-60])
    head_file(tmp_path).write_bytes(head)
    append_audit(tmp_path, "pin_changed", "li")
    lines = trail.read_bytes().splitlines(keepends=True)
    trail.write_bytes(b"".join([*lines[:3], lines[3].replace(b"SN-1", b"SN-2"), *lines[4:]]))
    assert first_bad(trail) == 4


def _append_many(folder: Path) -> None:
    for _ in range(20):
        append_audit(folder, "file_saved", "wang")


def test_concurrent_processes_append_to_one_chain(tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    processes = [context.Process(target=_append_many, args=(tmp_path,)) for _ in range(2)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
        assert process.exitcode == 0
    chain = read_audit(audit_path(tmp_path))
    assert (len(chain.entries), chain.damage) == (40, None)


def test_trail_locked_by_another_process_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("calstation.records.evidence.chained_lines.LOCK_TIMEOUT", 0.0)
    with files.locked(tmp_path / ".audit.lock", 1.0), raises_code(ConfigurationError, "audit.unwritable"):
        append_audit(tmp_path, "pin_set", "wang")
