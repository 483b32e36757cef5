"""TOML and JSON that exceed a limit are refused in bounded time and memory, by the error of invalid text."""

import os
import tomllib
from pathlib import Path

import pytest

from calstation.errors import ConfigurationError
from calstation.parsing import MAX_JSON, MAX_TOML, parse_json, parse_toml, read_json, read_limited
from calstation.schema import StrictModel, load
from tests.helpers import raises_code

EXCESSIVE_TOML = {
    "bytes": "#" * (MAX_TOML + 1),
    "key": "a." * 100_000 + "a = 1",
    "quoted key": '"a" . ' * 100 + "a = 1",
    "header": f"[{'.'.join('a' * 100)}]",
    "lists": "a = " + "[" * 50_000,
    "tables": "a = " + "{a=" * 50_000,
    "depth": "a = " + "[" * 100 + "]" * 100,
    "digits": "a = " + "9" * 5000,
    "hexadecimal": "a = 0x" + "f" * 100_000,
}
EXCESSIVE_JSON = {
    "bytes": " " * (MAX_JSON + 1),
    "lists": "[" * 100_000,
    "tables": '{"a":' * 100_000,
    "depth": "[" * 100 + "]" * 100,
    "digits": "9" * 5000,
    "number": '{"a": ' + "9" * 400 + "}",
}


class Number(StrictModel):
    """A file with one number."""

    value: float


@pytest.mark.parametrize("name", EXCESSIVE_TOML)
def test_excessive_toml_is_refused(name: str) -> None:
    with pytest.raises(tomllib.TOMLDecodeError, match="at line 1,"):
        parse_toml(EXCESSIVE_TOML[name])


@pytest.mark.parametrize("name", EXCESSIVE_JSON)
def test_excessive_json_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match=r"More than|too many"):
        parse_json(EXCESSIVE_JSON[name].encode())


def test_long_lists_and_texts_are_read() -> None:
    assert len(parse_toml(f'moves = {[[0.5, 1.5, 2.5]] * 5000}\na.b.c = "{"word " * 9000}"')["moves"]) == 5000
    assert len(parse_json(f"{[[0.5]] * 5000}")) == 5000


@pytest.mark.parametrize("text", ["1e300", "-1e300", "1" + "0" * 19 + "e60"])
def test_number_whose_powers_overflow_is_refused_by_its_name(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.toml").write_text(f"value = {text}", "utf-8")
    with raises_code(ConfigurationError, "entry.in_file") as caught:
        load(Number, tmp_path / "a.toml")
    assert "value: " in str(caught.value)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes in folders exist on POSIX only")
def test_a_pipe_or_an_endless_file_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.json")
    for path in (tmp_path / "pipe.json", Path("/dev/zero")):
        with pytest.raises(OSError, match="seek"):
            read_json(path)
    with pytest.raises(IsADirectoryError):
        read_limited(tmp_path, 10)
    (tmp_path / "long.toml").write_bytes(b"#" * 100)
    assert len(read_limited(tmp_path / "long.toml", 10)) == 11
