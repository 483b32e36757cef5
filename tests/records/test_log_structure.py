"""A file with the parts of a raw log but another structure is refused before data are read."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from calstation.errors import InputError
from calstation.estimation.common import SampleBlock
from calstation.records import LogMeta, RawLogWriter, open_log
from calstation.records.raw.raw_log import row_checks

PARTS = ("samples", "meta", "stages", "events", "results", "closing")
Edit = Callable[[h5py.File, str], object]


def _replace(file: h5py.File, name: str, *args: object, **options: object) -> None:
    del file[name]
    file.create_dataset(name, *args, **options)


def _type_of(file: h5py.File, name: str) -> None:
    del file[name]
    file[name] = np.dtype("<f8")


def _soft_link(file: h5py.File, name: str) -> None:
    file.move(name, "elsewhere")
    file[name] = h5py.SoftLink("/elsewhere")


def _external_link(file: h5py.File, name: str) -> None:
    del file[name]
    file[name] = h5py.ExternalLink("other.h5", name)


def _compressed(file: h5py.File, name: str) -> None:
    data = file[name][:]
    _replace(file, name, data=data, chunks=(16,), maxshape=(None,), compression="gzip")


def _virtual(file: h5py.File, name: str) -> None:
    dtype = file[name].dtype
    del file[name]
    layout = h5py.VirtualLayout((8,), dtype)
    layout[:] = h5py.VirtualSource("other.h5", name, (8,))
    file.create_virtual_dataset(name, layout)


def _huge_chunk(file: h5py.File, name: str) -> None:
    rows = (1 << 29) // file[name].dtype.itemsize
    _replace(file, name, (0,), file[name].dtype, maxshape=(None,), chunks=(rows,))


EDITS: dict[str, Edit] = {
    "missing": lambda file, name: file.__delitem__(name),
    "group": lambda file, name: (file.__delitem__(name), file.create_group(name)),
    "named type": _type_of,
    "soft link": _soft_link,
    "external link": _external_link,
    "scalar": lambda file, name: _replace(file, name, data=np.zeros((), file[name].dtype)),
    "no space": lambda file, name: _replace(file, name, data=h5py.Empty(file[name].dtype)),
    "two dimensions": lambda file, name: _replace(file, name, (4, 4), file[name].dtype),
    "string": lambda file, name: _replace(file, name, (4,), h5py.string_dtype()),
    "complex": lambda file, name: _replace(file, name, (4,), np.complex128),
    "reference": lambda file, name: _replace(file, name, (4,), h5py.ref_dtype),
    "other compound": lambda file, name: _replace(file, name, (4,), np.dtype([("seq", "<i8"), ("time", "<f4", (9,))])),
    "external storage": lambda file, name: _replace(
        file, name, (4,), file[name].dtype, external=[("/etc/passwd", 0, 4 * file[name].dtype.itemsize)]
    ),
    "compressed": _compressed,
    "virtual": _virtual,
    "huge chunk": _huge_chunk,
}
HUGE = [(name, size) for name in PARTS if name != "samples" for size in (3 << 30, 512 << 30)]


@pytest.fixture
def path(tmp_path: Path, meta: LogMeta, blocks: list[SampleBlock]) -> Path:
    path = tmp_path / "run.h5"
    writer = RawLogWriter(path, meta)
    writer.append(blocks[0])
    writer.event({"event": "StageSolved", "stage": "rate"})
    writer.add_result({"outcome": "passed"})
    writer.close("passed")
    return path


def _refusal(path: Path) -> InputError:
    with pytest.raises(InputError) as caught:
        list(open_log(path).blocks())
    return caught.value


@pytest.mark.parametrize("edit", EDITS)
@pytest.mark.parametrize("name", PARTS)
def test_every_part_with_another_structure_is_named(path: Path, name: str, edit: str) -> None:
    with h5py.File(path, "r+", libver="latest") as file:
        EDITS[edit](file, name)
    error = _refusal(path)
    if (name, edit) == ("samples", "missing"):
        assert error.code == "log.foreign"
    else:
        assert error.code == "log.structure"
        assert error.values["part"] == name


@pytest.mark.parametrize(("name", "size"), HUGE)
def test_huge_parts_are_refused_before_they_are_read(path: Path, name: str, size: int) -> None:
    with h5py.File(path, "r+", libver="latest") as file:
        dtype = file[name].dtype
        _replace(file, name, (size // dtype.itemsize,), dtype, maxshape=(None,), chunks=(1024,))
    assert _refusal(path).values["part"] == name


def test_a_huge_number_of_rows_is_limited_by_the_size_of_the_file(path: Path, blocks: list[SampleBlock]) -> None:
    with h5py.File(path, "r+", libver="latest") as file:
        file["samples"].resize((1 << 40,))
    assert open_log(path).facts().samples == len(blocks[0])


@pytest.mark.parametrize(("column", "value"), [("angles", 1e300), ("counts", np.inf), ("time", -1e300), ("seq", 2**62)])
def test_an_impossible_value_with_a_valid_checksum_is_named(path: Path, column: str, value: float) -> None:
    with h5py.File(path, "r+", libver="latest") as file:
        rows = file["samples"][-1:]
        rows[column] = value
        rows["check"] = row_checks(rows)
        file["samples"][-1:] = rows
    error = _refusal(path)
    assert (error.code, error.values["column"]) == ("log.impossible_sample", column)


def test_the_counts_of_an_invalid_sample_may_be_infinite(
    tmp_path: Path, meta: LogMeta, blocks: list[SampleBlock]
) -> None:
    counts, valid = blocks[0].counts.copy(), blocks[0].valid.copy()
    counts[3], valid[3] = np.inf, False
    writer = RawLogWriter(tmp_path / "earlier.h5", meta)
    writer.append(replace(blocks[0], counts=counts, valid=valid))
    written = writer.close("failed")
    assert open_log(tmp_path / "earlier.h5").facts() == written


@pytest.mark.parametrize("value", ["text", np.zeros(3, np.uint32), 1.5, h5py.Empty("u4")])
def test_an_attribute_with_another_structure_is_named(path: Path, value: object) -> None:
    with h5py.File(path, "r+", libver="latest") as file:
        file.attrs["meta_crc32"] = value
    assert _refusal(path).values["part"] == "meta_crc32"


@pytest.mark.parametrize("value", ["calstation.log/1", np.zeros(3, "S16"), 1, h5py.Empty("S16")])
def test_an_attribute_that_is_not_the_format_makes_the_file_foreign(path: Path, value: object) -> None:
    with h5py.File(path, "r+", libver="latest") as file:
        file.attrs["format"] = value
    assert _refusal(path).code == "log.foreign"
