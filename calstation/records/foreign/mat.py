"""MATLAB `.mat` files: `imu` arrays of PSINS, and columns of other arrays by `[columns]`; also version 7.3 (HDF5).

PSINS (psins.org.cn): an array (n, 7) of angle increments, rad, velocity increments, m/s, and time, s.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from calstation.errors import InputError
from calstation.physics import FloatArray
from calstation.records.foreign.mat_size import MAX_NUMBERS, check_size
from calstation.records.foreign.topics import Columns, ForeignFormat, Topic

_PSINS_WIDTH = 7
#: Signature of HDF5, which begins the data of a file of version 7.3, and its position.
_HDF5, _HDF5_AT = b"\x89HDF\r\n\x1a\n", 512


def _topics(path: Path) -> list[Topic]:
    topics = []
    for name, array in _arrays(path).items():
        later, earlier = array[1:, -1], array[:-1, -1]
        is_imu = array.shape[1] == _PSINS_WIDTH and len(array) > 1 and bool((later > earlier).all())
        names = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z", "time_s")
        units = ("rad",) * 3 + ("m/s",) * 3 + ("s",)
        columns = {n: (f"{name}(:,{k})", u) for k, (n, u) in enumerate(zip(names, units, strict=True), 1)}
        topics.append(Topic(name, "x".join(map(str, array.shape)), len(array), columns if is_imu else {}))
    return topics


def _read(path: Path, topic: Topic) -> Iterator[Columns]:
    arrays = _arrays(path)
    rows = len(arrays[topic.name])
    columns = dict[str, FloatArray]()
    for name, array in arrays.items():
        if len(array) == rows:
            columns |= {f"{name}(:,{k})": array[:, k - 1] for k in range(1, array.shape[1] + 1)}
            columns |= {name: array[:, 0]} if array.shape[1] == 1 else {}
    yield columns


def _arrays(path: Path) -> dict[str, FloatArray]:
    """Return the arrays of numbers with more than one row, shape (n, k), in a file and in its structures."""
    with path.open("rb") as stream:
        stream.seek(_HDF5_AT)
        is_hdf5 = stream.read(len(_HDF5)) == _HDF5
    arrays: dict[str, FloatArray] = {}
    if is_hdf5:
        with h5py.File(path, "r") as file:
            _collect_hdf5("", file, arrays, max(MAX_NUMBERS, path.stat().st_size))
    else:
        from scipy.io import loadmat

        check_size(path)
        for name, value in loadmat(path, simplify_cells=True).items():
            if not name.startswith("__"):
                _collect(name, value, arrays)
    return arrays


def _collect(name: str, value: Any, arrays: dict[str, FloatArray]) -> None:
    if isinstance(value, dict):
        for key, item in value.items():
            _collect(f"{name}.{key}", item, arrays)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "fiu" and value.ndim in (1, 2) and len(value) > 1:
        arrays[name] = np.asarray(value.reshape(len(value), -1), np.float64)


def _collect_hdf5(name: str, group: Any, arrays: dict[str, FloatArray], limit: int) -> None:
    """Collect the arrays of a group, of at most `limit` numbers, without following links to other files and groups."""
    for key in group:
        if key.startswith("#") or not isinstance(group.get(key, getlink=True), h5py.HardLink):
            continue
        item = group[key]
        if isinstance(item, h5py.Group):
            _collect_hdf5(f"{name}{key}.", item, arrays, limit)
        elif isinstance(item, h5py.Dataset) and item.dtype.kind in "fiu" and item.ndim == 2:
            if sum(array.size for array in arrays.values()) + item.size > limit or item.external or item.is_virtual:
                raise InputError("foreign.too_large", file=group.file.filename)
            value = item[:].T  # MATLAB stores columns first
            _collect(f"{name}{key}", value.T if len(value) == 1 else value, arrays)


FORMAT = ForeignFormat("MATLAB", (".mat",), "h5py", _topics, _read)
