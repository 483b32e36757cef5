"""Every registered format of logs is read, written, recognised by its name and counted."""

from pathlib import Path

import pytest
from records_samples import joined

from calstation.errors import InputError
from calstation.estimation.common import SampleBlock
from calstation.records import LOG_FORMATS, LOG_SUFFIXES, LogMeta, estimated_rows, log_format, open_log
from tests.helpers import raises_code


@pytest.mark.parametrize("known", LOG_FORMATS, ids=lambda known: known.name)
def test_log_is_read_as_written(known, tmp_path: Path, meta: LogMeta, blocks: list[SampleBlock]) -> None:
    path = tmp_path / f"log{known.suffixes[0]}"
    known.write(path, meta, iter(blocks))
    log = open_log(path)
    assert log.meta == meta
    written, read = joined(blocks), joined(list(log.blocks()))
    assert all((read[name] == written[name]).all() for name in ("seq", "time", "counts", "step"))
    assert estimated_rows(path) == pytest.approx(sum(map(len, blocks)), rel=0.1)
    beside = [each.name for each in tmp_path.iterdir() if each != path]
    assert beside == ([] if known.configuration_path is None else [known.configuration_path(path).name])


@pytest.mark.parametrize("known", LOG_FORMATS, ids=lambda known: known.name)
def test_missing_log_is_refused(known, tmp_path: Path) -> None:
    for suffix in known.suffixes:
        assert log_format(tmp_path / f"log{suffix}") is known
        assert suffix in LOG_SUFFIXES
    with raises_code(InputError, "log.not_found"):
        open_log(tmp_path / f"log{known.suffixes[0]}")


def test_file_of_another_format_is_no_log(tmp_path: Path) -> None:
    for use in (open_log, estimated_rows):
        with raises_code(InputError, "log.not_a_log"):
            use(tmp_path / "log.bin")
