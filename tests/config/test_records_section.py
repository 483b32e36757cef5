"""`[records]` of a station file names a database and an archive, and contains no credentials."""

from pathlib import Path

import pytest

from calstation.config import library, load_station
from calstation.errors import ConfigurationError


def station(folder: Path, text: str) -> Path:
    """The shipped virtual station with a section `[records]`."""
    path = folder / "line.toml"
    shipped = library.find("stations", "virtual_bench").read_text(encoding="utf-8")
    path.write_text(f"{shipped}\n[records]\n{text}\n", encoding="utf-8")
    return path


def test_records_stay_on_this_computer_by_default() -> None:
    records = load_station(None)[1].records
    assert (records.database, records.archive) == (None, None)


def test_database_and_archive_settings_are_read(tmp_path: Path) -> None:
    text = 'database = "postgresql+psycopg://line@server/records"\narchive = "s3://bucket/logs"'
    records = load_station(station(tmp_path, text))[1].records
    assert records.database == "postgresql+psycopg://line@server/records"
    assert records.archive == "s3://bucket/logs"


@pytest.mark.parametrize(
    "url",
    [
        "postgresql+psycopg://line@server:5432/records?sslmode=verify-full&sslkey=/etc/calstation/line.key",
        "postgresql+psycopg://server:5432/records?application_name=line",
        "sqlite:////srv/a:b@c/records.sqlite",
    ],
)
def test_a_url_without_a_password_is_accepted(tmp_path: Path, url: str) -> None:
    assert load_station(station(tmp_path, f'database = "{url}"'))[1].records.database == url


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ('database = "postgresql+psycopg://line:geheim@server/records"', "database.password_in_url"),
        ('database = "postgresql+psycopg://line@server/records?password=geheim"', "database.password_in_url"),
        ('database = "postgresql+psycopg://line:ge#heim@server/geheim"', "database.password_in_url"),
        ('database = "postgresql+psycopg://line:ge/heim?@server/geheim"', "database.password_in_url"),
        ('database = "postgresql+psycopg://server/records?sslpassword=geheim"', "database.password_in_url"),
        ('database = "postgresql+psycopg://server/records?a=b&SSL%50assword=geheim"', "database.password_in_url"),
        ('database = "mysql://line:geheim@server/records"', "database.other_kind"),
        ('database = "geheim"', "database.no_url"),
        ('archive = "s3://key:geheim@bucket/logs"', "database.password_in_archive"),
        ('archive = "s3://key:ge#heim@bucket/geheim"', "database.password_in_archive"),
        ('archive = "https://server/logs?x-token=geheim"', "database.password_in_archive"),
        ('databse = "geheim"', None),
    ],
)
def test_file_with_a_password_is_refused_and_the_password_not_shown(
    tmp_path: Path, text: str, code: str | None
) -> None:
    with pytest.raises(ConfigurationError) as caught:
        load_station(station(tmp_path, text))
    what = caught.value.values["what"]
    if code is not None:
        assert code in (what.code, getattr(what.values.get("what"), "code", None))
        assert "geheim" not in str(caught.value)
