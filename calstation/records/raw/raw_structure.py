"""Check of the structure of an HDF5 file before any data are read from it.

Another program, or an attacker, may write an HDF5 file whose objects have the names of a raw log but other
types, ranks or sizes, or which are links to other files. Reading them would fail in unforeseen ways or use all memory.
"""

import h5py
import numpy as np

from calstation.messages import Text
from calstation.records.raw.raw_log import FORMAT, TEXTS, row_dtype
from calstation.records.raw.superblock import SUPERBLOCK

#: Size limits of the datasets that are read at once, bytes.
_MAX_BYTES = {"meta": 1 << 24, "events": 1 << 25, "results": 1 << 25, "closing": 1 << 20, "stages": 1 << 22}
#: Size limit of a chunk, bytes, because HDF5 may load a whole chunk to read one row.
_MAX_CHUNK_BYTES = 1 << 24
_STAGE = np.dtype("S64")
#: Largest number of secondary IMUs.
_MAX_FURTHER_IMUS = 8


class StructureError(OSError):
    """A part of an HDF5 file differs from the part of a raw log with the same name."""

    def __init__(self, part: str, what: Text) -> None:
        super().__init__(part, str(what))
        self.part, self.what = part, what


def is_raw_log(file: h5py.File) -> bool:
    """Return whether a file has the format of a raw log.

    Strings of variable length are not read, because HDF5 may hang on them.
    """
    if "format" not in file.attrs or not file.id.links.exists(b"samples"):
        return False
    form = file.attrs.get_id("format")
    is_fixed = form.shape == () and form.dtype.kind == "S" and form.dtype.itemsize <= SUPERBLOCK
    return is_fixed and bool(file.attrs["format"] == FORMAT.encode())


def check_structure(file: h5py.File) -> None:
    """Check types, ranks, sizes, links, filters and storage of all parts of a raw log. Raises StructureError.

    The number of rows is not checked, because it may be damaged; the reader limits it by the file's size.
    """
    for name in ("samples", *_MAX_BYTES):
        try:
            _check_dataset(file, name)
        except StructureError:
            raise
        except (OSError, RuntimeError, KeyError):
            if name not in TEXTS:
                raise  # the reader does not need the events and results
    check = file.attrs.get_id("meta_crc32") if "meta_crc32" in file.attrs else None
    if check is None or check.shape != () or check.dtype.kind not in "iu":
        raise StructureError("meta_crc32", Text("log.part_type"))


def _check_dataset(file: h5py.File, name: str) -> None:
    key = name.encode()
    if not file.id.links.exists(key):
        raise StructureError(name, Text("log.part_missing"))
    if file.id.links.get_info(key).type != h5py.h5l.TYPE_HARD or not _is_dataset(file, key):
        raise StructureError(name, Text("log.part_link"))
    dataset = h5py.h5d.open(file.id, key)
    storage = dataset.get_create_plist()
    if storage.get_layout() == h5py.h5d.VIRTUAL or storage.get_external_count() or storage.get_nfilters():
        raise StructureError(name, Text("log.part_storage"))
    try:
        dtype = dataset.dtype
    except (TypeError, ValueError):
        raise StructureError(name, Text("log.part_type")) from None
    if dataset.rank != 1 or not _is_expected(name, dtype):
        raise StructureError(name, Text("log.part_type"))
    chunk = storage.get_chunk()[0] if storage.get_layout() == h5py.h5d.CHUNKED else 0
    sizes = ((chunk, _MAX_CHUNK_BYTES), (dataset.shape[0], _MAX_BYTES.get(name)))
    for count, limit in sizes:
        if limit is not None and count * dtype.itemsize > limit:
            raise StructureError(name, Text.of("log.part_size", megabytes=limit >> 20))


def _is_dataset(file: h5py.File, key: bytes) -> bool:
    return bool(h5py.h5o.get_info(file.id, key).type == h5py.h5o.TYPE_DATASET)


def _is_expected(name: str, dtype: np.dtype) -> bool:
    if name == "stages":
        return dtype == _STAGE
    if name != "samples":
        return dtype == np.uint8
    fields = dict(dtype.fields or {})
    others = fields["others"][0].shape if "others" in fields else ()
    further_imus = others[0] if others else 0
    return further_imus <= _MAX_FURTHER_IMUS and dtype == row_dtype(
        further_imus, *(name in fields for name in ("joints", "station", "chamber"))
    )
