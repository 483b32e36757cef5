"""The audit trail is a hash chain that reveals later changes and survives a process killed while writing."""

import hashlib
import json
import multiprocessing
import re
from pathlib import Path

import pytest

from calstation.errors import ConfigurationError
from calstation.records import append_audit, audit_path, files, read_audit
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


def test_line_with_a_recomputed_digest_is_detected_at_the_next_line(tmp_path: Path, trail: Path) -> None:
    lines = trail.read_text("utf-8").splitlines(keepends=True)
    rest = re.sub(r', "digest": "[0-9a-f]{64}"\}\n$', "}", lines[1]).replace("new limits", "none")
    digest = hashlib.sha256(rest.encode()).hexdigest()
    lines[1] = f'{rest[:-1]}, "digest": "{digest}"}}\n'
    trail.write_text("".join(lines), encoding="utf-8")
    assert first_bad(trail) == 3


def test_truncated_line_is_reported_and_the_chain_continues_after_it(tmp_path: Path, trail: Path) -> None:
    whole = trail.read_bytes()
    start = whole.rstrip(b"\n").rindex(b"\n") + 1
    for end in range(start + 1, len(whole) - 1):
        trail.write_bytes(whole[:end])
        assert (read_audit(trail).incomplete, first_bad(trail)) == ((3,), None)
        append_audit(tmp_path, "pin_changed", "li")
        chain = read_audit(trail)
        assert (chain.incomplete, chain.damage) == ((3,), None)
        assert [each.event for each in chain.entries] == ["pin_set", "file_saved", "pin_changed"]
        assert trail.read_bytes().startswith(whole[:end])


def test_emptied_trail_remains_damaged_after_the_next_event(tmp_path: Path, trail: Path) -> None:
    trail.write_bytes(b"")
    append_audit(tmp_path, "pin_changed", "li")
    assert first_bad(trail) == 1


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


def test_modified_last_line_is_not_treated_as_incomplete(tmp_path: Path, trail: Path) -> None:
    trail.write_bytes(trail.read_bytes()[:-1].replace(b"SN-1", b"SN-2"))
    assert first_bad(trail) == 3
    append_audit(tmp_path, "pin_changed", "li")
    assert first_bad(trail) == 3


def test_change_of_an_incomplete_line_is_detected(tmp_path: Path, trail: Path) -> None:
    trail.write_bytes(trail.read_bytes()[:-60])
    append_audit(tmp_path, "pin_changed", "li")
    trail.write_bytes(trail.read_bytes().replace(b"SN-1", b"SN-2"))
    assert first_bad(trail) == 3


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
    monkeypatch.setattr("calstation.records.chained_lines.LOCK_TIMEOUT", 0.0)
    with files.locked(tmp_path / ".audit.lock", 1.0), raises_code(ConfigurationError, "audit.unwritable"):
        append_audit(tmp_path, "pin_set", "wang")
