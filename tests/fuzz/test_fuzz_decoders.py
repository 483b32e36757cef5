"""Decoders accept arbitrary bytes without hanging, crashing or unlimited buffering; atheris is used if installed."""

import importlib.util
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import file_targets
import pytest
from hypothesis import given
from hypothesis import strategies as st
from targets import TARGETS, decoder

SECONDS = 3

pieces = st.one_of(
    st.binary(max_size=60),
    st.sampled_from([b"\xfa\xff\x36", b"\xfa\xff\x36\xff", b"ue\x80", b"\x55\xaa", b"\x55\x5a\x02\xff", b"\xaf"]),
    st.sampled_from([b"$VNIMU,", b"$VN", b"*", b"\r\n", b"$VNIMU,T1,2,3,4,5,6,7*", b"\x01\x03\xff", b"\xff" * 40]),
)


@pytest.mark.parametrize("name", [name for name in TARGETS if name not in file_targets.TARGETS])
@given(parts=st.lists(pieces, max_size=30))
def test_decoder_accepts_arbitrary_bytes(name: str, parts: list[bytes]) -> None:
    TARGETS[name](b"".join(parts))


@pytest.mark.parametrize("name", file_targets.TARGETS)
@given(
    data=st.lists(pieces, max_size=5).map(b"".join)
    | st.recursive(
        st.none() | st.integers() | st.floats() | st.text(max_size=9),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    ).map(lambda value: json.dumps(value).encode())
)
def test_file_reader_accepts_arbitrary_content(name: str, data: bytes) -> None:
    for first in (b"", b"\x00", b"\x03", b"\xf1"):
        TARGETS[name](first + data)


@pytest.mark.parametrize("name", [n.removeprefix("stream ") for n in TARGETS if n.startswith("stream")])
@given(parts=st.lists(pieces, max_size=20), cut=st.integers(1, 50))
def test_noise_decodes_identically_however_it_is_split(name: str, parts: list[bytes], cut: int) -> None:
    data = b"".join(parts)
    whole, _ = decoder(name)
    cutting, _ = decoder(name)
    at_once = whole.feed(data)
    in_pieces = [cutting.feed(data[k : k + cut]) for k in range(0, len(data), cut)]
    assert [frame for part in in_pieces for frame in part.frames.raw] == list(at_once.frames.raw)
    assert [reply for part in in_pieces for reply in part.replies] == list(at_once.replies)
    assert (cutting.skipped, cutting.crc_errors, cutting._buffer) == (
        whole.skipped,
        whole.crc_errors,
        whole._buffer,
    )


@pytest.mark.exhaustive
@pytest.mark.skipif(
    importlib.util.find_spec("atheris") is None,
    reason="atheris is not installed: not fuzzed by coverage here",
)
def test_short_atheris_run_finds_no_failure(tmp_path: Path) -> None:
    run = subprocess.run(
        [
            sys.executable,
            str(Path(__file__).with_name("harness.py")),
            f"-max_total_time={SECONDS}",
            str(tmp_path),
        ],
        capture_output=True,
        text=True,
        check=False,
        timeout=240,
        cwd=tmp_path,
    )
    assert run.returncode == 0, run.stderr[-3000:]


def test_every_target_accepts_empty_input() -> None:
    target: Callable[[bytes], None]
    for target in TARGETS.values():
        target(b"")
