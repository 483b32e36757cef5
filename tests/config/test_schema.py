"""Cached files are read again only after a change, and read errors name the file."""

from pathlib import Path

import pytest

from calstation import schema
from calstation.errors import ConfigurationError
from calstation.schema import StrictModel, load_once
from tests.helpers import raises_code


class Named(StrictModel):
    """A file with one entry."""

    name: str


def test_unreadable_file_is_a_configuration_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(path: Path, limit: int) -> bytes:
        raise PermissionError(13, "denied", str(path))

    (tmp_path / "a.toml").write_text('name = "a"', "utf-8")
    monkeypatch.setattr(schema, "read_limited", refuse)
    with raises_code(ConfigurationError, "entry.unreadable"):
        load_once(Named, tmp_path / "a.toml")


def test_file_replaced_during_reading_is_not_cached(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.toml"
    path.write_text('name = "old"', "utf-8")
    with monkeypatch.context() as patched:
        read = schema.read_limited

        def read_and_replace(file: Path, limit: int) -> bytes:
            content = read(file, limit)
            path.write_text('name = "new"', "utf-8")
            return content

        patched.setattr(schema, "read_limited", read_and_replace)
        assert load_once(Named, path).name == "old"
    assert load_once(Named, path).name == "new"
    path.write_text('name = "old"', "utf-8")
    assert load_once(Named, path).name == "old"
