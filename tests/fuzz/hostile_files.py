"""Structure-aware hostile files of every kind: `python tests/fuzz/hostile_files.py FIRST COUNT` opens them by command.

A file is a valid one in which a part is replaced by a value that somebody with intent, another program or a damaged
disk may have written, with valid checksums. Every command runs in a process with limits of time and memory.
"""

import gzip
import io
import json
import os
import random
import resource
import signal
import sys
import time
import tomllib
import zlib
from collections import Counter
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import tomli_w

from calstation.cli.app import run_app
from calstation.estimation.common import SampleBlock
from calstation.records import LogMeta, RawLogWriter
from calstation.records.raw.raw_log import CHECKSUM_COLUMN, row_checks

sys.path.append(str(Path(__file__).parent))  # as pytest does

from hostile_recordings import Recordings

DATA = Path(__file__).parents[2] / "data"
#: Limits of a command: time, s, and memory beyond that of the imported program, bytes.
TIME_LIMIT, MEMORY_LIMIT = 10, 1 << 30
STAGE, RATE = "multi_position", 20.0
META: dict[str, Any] = {
    "site": {"latitude_deg": 34.25, "longitude_deg": 108.9, "height_m": 400.0, "azimuth_deg": 0.0},
    "imu": {
        "serial": "SN-7",
        "sample_rate_hz": RATE,
        "output": "rate",
        "gyro_lsb": 1e-6,
        "accel_lsb": 1e-5,
        "gyro_arw": 1e-4,
        "accel_vrw": 1e-3,
    },
    "table": {"encoder_sigma_deg": 0.03},
    "prior": {"gyro_bias_x": {"value": 1e-7, "sigma": 1e-3}},
    "prior_correlation": {"gyro_bias_y": {"gyro_bias_x": 0.1}},
    "product": {"name": "unit", "limits": {"gyro_bias": {"within": 1e-2, "sigma_below": 1e-3}}},
    "run": {"stages": [STAGE], "station": "here", "software": "0.1", "started_utc": "2026-11-21T10:00:00Z"},
    "schedule": {STAGE: {"rest_s": 8.0}},
    "profiles": {"product": 'stages = ["multi_position"]\n'},
}
WORDS = (
    *(
        "",
        " ",
        "rate",
        "nan",
        "inf",
        "-1",
        "1e300",
        "=cmd|' /C calc'!A1",
        "[/red]",
        "\x1b[2J",
        "\x00",
        "\u202e",
        "测" * 40,
    ),
    *("../../etc/passwd", "{serial} %s", "a" * 300, "a" * 100_000, "2026-99-99T00:00:00Z", "0x" + "f" * 40, "9" * 5000),
)
NUMBERS = (0, -1, 1, 2**31, 2**53 + 1, 2**63, -(2**63), 0.5, -0.0, 1e-300, 1e-30, 1e30, 1e59, 1e300, -1e300)


def values(chance: random.Random, *, json_only: bool = False) -> Any:
    """Return a hostile value."""
    kind = chance.randrange(8)
    if kind < 3:
        return chance.choice(NUMBERS)
    if kind < 5:
        return chance.choice(WORDS)
    special = (math_value for math_value in (float("nan"), float("inf"), True, False))
    extra = [None, 10**30] if json_only else []
    nested: Any = 1
    for _ in range(chance.choice((3, 50, 200))):
        nested = [nested] if chance.random() < 0.5 else {"a": nested}
    lists = ([], {}, [1.0, "a"], [0.0] * 3, [[0, 0]], {"x": 1}, [1e300] * 3, list(range(1000)), nested)
    return chance.choice([*special, *extra, *lists])


def key_paths(data: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the paths of all values in nested tables and lists."""
    if path:
        yield path
    inside = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in inside:
        yield from key_paths(value, (*path, key))


def mutate(data: Any, chance: random.Random, *, json_only: bool = False) -> Any:
    """Replace, remove, rename or add one or two values of nested tables."""
    for _ in range(chance.choice((1, 1, 1, 2))):
        *parents, last = chance.choice(list(key_paths(data)) or [("a",)])
        inner = data
        for key in parents:
            inner = inner[key]
        action = chance.randrange(6)
        if action == 0:
            del inner[last]
        elif action == 1 and isinstance(inner, dict):
            inner[chance.choice(WORDS) or "a"] = inner.pop(last)
        elif action == 2 and isinstance(inner, dict):
            inner[chance.choice(WORDS) or "a"] = values(chance, json_only=json_only)
        else:
            inner[last] = values(chance, json_only=json_only)
    return data


def samples() -> SampleBlock:
    """Return a short multi-position recording, whose rests and motions agree with gravity and the earth rate."""
    outer, inner, rates = [0.0], [0.0], [(0.0, 0.0)]
    moves = [
        (0, 90),
        (0, 90),
        (0, 90),
        (0, 90),
        (1, 90),
        (0, 90),
        (1, 90),
        (0, 90),
        (1, 90),
        (0, 90),
        (0, -90),
        (1, 90),
    ]
    for axis, degrees in moves:
        for _ in range(int(5 * RATE)):
            outer.append(outer[-1])
            inner.append(inner[-1])
            rates.append((0.0, 0.0))
        count = int(3 * RATE)
        for _ in range(count):
            step = np.deg2rad(degrees) / count
            outer.append(outer[-1] + step * (axis == 0))
            inner.append(inner[-1] + step * (axis == 1))
            rates.append((step * RATE * (axis == 0), step * RATE * (axis == 1)))
    n, noise = len(outer), np.random.default_rng(1)
    counts = np.zeros((n, 6))
    for k, (a, b, (p, q)) in enumerate(zip(outer, inner, rates, strict=True)):
        rx = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
        rz = np.array([[np.cos(b), -np.sin(b), 0], [np.sin(b), np.cos(b), 0], [0, 0, 1]])
        body = (rx @ rz).T
        earth = 7.292115e-5 * np.array([0.0, np.cos(np.deg2rad(34.25)), np.sin(np.deg2rad(34.25))])
        counts[k, :3] = (body @ earth + rz.T @ [p, 0, 0] + [0, 0, q]) / 1e-6
        counts[k, 3:] = body @ [0, 0, 9.7965] / 1e-5
    counts = np.rint(counts + noise.normal(0.0, 1.0, counts.shape) * [300.0] * 6)
    seq = np.arange(n)
    angles = np.column_stack([outer, inner])
    return SampleBlock(STAGE, seq, (seq + 1) / RATE, counts, angles, seq * 0, seq >= 0, np.full(n, 25.0))


class Files:
    """Makes hostile files in a folder, each from its seed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        self._recordings = Recordings(folder)
        self._block = samples()
        path = folder / "base.h5"
        writer = RawLogWriter(path, LogMeta.model_validate(META))
        writer.append(self._block)
        writer.event({"event": "StepStarted", "stage": STAGE, "step": 0, "kind": "dwell", "label": ["up", 1.0]})
        writer.event({"event": "StageSolved", "stage": STAGE})
        writer.close("passed")
        self._log = path.read_bytes()
        run_app(["export", str(path), "-o", str(folder / "base.csv")])
        self._csv = (folder / "base.csv").read_text("utf-8")
        run_app(["resolve", str(path), "--json", str(folder / "base.json")])
        self._result = json.loads((folder / "base.json").read_text("utf-8"))
        for arguments in (["check", str(path)], ["apply", str(folder / "base.json"), str(path)]):
            run_here(arguments)  # imports what the commands need

    def make(self, seed: int) -> list[str]:
        """Write the file of a seed, and return the arguments of the command that opens it."""
        chance = random.Random(seed)
        own = (self._raw_log, self._csv_rows, self._csv_configuration, self._toml, self._json)
        kind = seed % (len(own) + len(self._recordings.kinds))
        if kind >= len(own):
            return self._recordings.make(kind - len(own), chance)
        return [str(argument) for argument in own[kind](chance)]

    def _command(self, chance: random.Random, log: Path) -> list[Any]:
        target = self.folder / "out"
        return chance.choice(
            [
                ["resolve", log, "--json", "-"],
                ["resolve", log, "--residuals"],
                ["resolve", log, "--stages", STAGE],
                ["check", log],
                ["export", log, "-o", f"{target}.csv"],
                ["apply", self.folder / "base.json", log],
                ["report", log, "-o", f"{target}.pdf"] if chance.random() < 0.2 else ["check", log],
                ["import", log, "-o", f"{target}{chance.randrange(1 << 30)}.h5"],
            ]
        )

    def _raw_log(self, chance: random.Random) -> list[Any]:
        path = self.folder / "hostile.h5"
        path.write_bytes(self._log)
        with h5py.File(path, "r+", libver="latest") as file:
            for _ in range(chance.randint(1, 2)):
                edit = chance.choice((self._structure, self._rows, self._rows, self._meta, self._meta, self._lines))
                edit(file, chance)
        return self._command(chance, path)

    @staticmethod
    def _structure(file: h5py.File, chance: random.Random) -> None:
        name = chance.choice(("samples", "meta", "stages", "events", "results", "closing"))
        if not isinstance(file.get(name), h5py.Dataset):
            return
        dtype = file[name].dtype
        data: dict[str, Any] = chance.choice(
            [
                {"data": 1.0},
                {"shape": (3, 3), "dtype": dtype},
                {"shape": (1 << 40,), "dtype": dtype, "chunks": (1024,)},
                {"shape": (1 << 40,), "dtype": dtype, "chunks": (1 << 20,), "maxshape": (None,)},
                {"data": [1 + 2j]},
                {"data": "text"},
                {"data": ["text"] * 3},
                {"shape": (4,), "dtype": h5py.ref_dtype},
                {"shape": (4,), "dtype": h5py.vlen_dtype(np.uint8)},
                {"shape": (4,), "dtype": h5py.enum_dtype({"a": 1})},
                {"shape": (4,), "dtype": np.dtype([("seq", "<i8"), ("counts", "<f8", (1000,))])},
                {"shape": (64,), "dtype": dtype, "chunks": (8,), "compression": "gzip"},
                {"shape": (0,), "dtype": dtype},
                {"group": True},
                {"link": h5py.SoftLink("/meta")},
                {"link": h5py.ExternalLink("/etc/passwd", "/x")},
            ]
        )
        del file[name]
        if "group" in data:
            file.create_group(name)
        elif "link" in data:
            file[name] = data["link"]
        else:
            file.create_dataset(name, **data)

    @staticmethod
    def _rows(file: h5py.File, chance: random.Random) -> None:
        samples = file.get("samples")
        if not isinstance(samples, h5py.Dataset) or CHECKSUM_COLUMN not in (samples.dtype.names or ()):
            return
        if samples.ndim != 1 or not 0 < len(samples) < 1_000_000:
            return
        rows = samples[:]
        column = chance.choice([name for name in rows.dtype.names if name != CHECKSUM_COLUMN])
        where = slice(chance.randrange(len(rows)), None) if chance.random() < 0.3 else chance.randrange(len(rows))
        cells = rows[column]
        if cells.dtype.kind == "f":
            value = chance.choice((np.nan, np.inf, -np.inf, 1e300, -1e300, 1e18, 1e9, 1e-300, 0.0))
            channel = chance.randrange(cells.shape[1]) if cells.ndim > 1 else ...
            cells[(where, channel) if cells.ndim > 1 else where] = value
        else:
            limits = np.iinfo(cells.dtype)
            cells[where] = chance.choice((limits.min, limits.max, 0, 1, limits.max // 2))
        rows[CHECKSUM_COLUMN] = row_checks(rows)
        samples[:] = rows
        if chance.random() < 0.2 and isinstance(file.get("stages"), h5py.Dataset) and file["stages"].shape == (1,):
            file["stages"][0] = chance.choice(WORDS).encode("utf-8", "replace")[:64]

    @staticmethod
    def _meta(file: h5py.File, chance: random.Random) -> None:
        if not isinstance(file.get("meta"), h5py.Dataset) or file["meta"].dtype != np.uint8:
            return
        meta = mutate(json.loads(json.dumps(META)), chance, json_only=True)
        content = np.frombuffer(json.dumps(meta).encode(), np.uint8)
        del file["meta"]
        file["meta"] = content
        file.attrs["meta_crc32"] = zlib.crc32(content.tobytes())
        if isinstance(closing := file.get("closing"), h5py.Dataset) and closing.maxshape == (None,):
            closing.resize((0,))  # without the digest of the run

    def _lines(self, file: h5py.File, chance: random.Random) -> None:
        name = chance.choice(("events", "results", "closing"))
        if not isinstance(file.get(name), h5py.Dataset) or file[name].dtype != np.uint8 or file[name].ndim != 1:
            return
        base: dict[str, Any] = {
            "events": {"event": "StepStarted", "stage": STAGE, "step": 0, "kind": "move", "label": ["up", 1.0]},
            "results": json.loads(json.dumps(self._result)),
            "closing": {"outcome": "passed", "sha256": "0" * 64},
        }[name]
        lines = [json.dumps(mutate(base, chance, json_only=True)), chance.choice(WORDS), "[" * 5000]
        text = "".join(f"{line}\n" for line in chance.sample(lines, chance.randint(1, 3)))
        content = np.frombuffer(text.encode("utf-8", "replace"), np.uint8)
        del file[name]
        file.create_dataset(name, data=content, maxshape=(None,), chunks=(8192,))

    def _csv_rows(self, chance: random.Random) -> list[Any]:
        lines = self._csv.splitlines()
        for _ in range(chance.randint(1, 3)):
            number = chance.randrange(len(lines)) if chance.random() < 0.8 else 0
            cells = lines[number].split(",")
            column = chance.randrange(len(cells))
            value = values(chance, json_only=True)
            cells[column] = str(value)
            action = chance.randrange(9)
            if action < 5:
                lines[number] = ",".join(cells)
            elif action == 5:
                lines[number : number + 1] = [lines[number]] * chance.choice((0, 2, 1000))
            elif action == 6:
                lines = [",".join(line.split(",")[:column] + line.split(",")[column + 1 :]) for line in lines]
            elif action == 7:
                rows = [line.split(",") for line in lines[1:]]
                lines = [lines[0], *(",".join([*row[:column], cells[column], *row[column + 1 :]]) for row in rows)]
            else:
                lines[number] = lines[number] * chance.choice((2, 10_000))
        end = chance.choice(("\n", "\n", "\r\n", "\r", "\n\n", "\x00\n"))
        content = end.join(lines).encode("utf-8", "replace") + chance.choice((b"", b"\n", b"\xff", b"1" * 300_000))
        if chance.random() < 0.1:
            content = content.decode("utf-8", "replace").encode(chance.choice(("utf-16", "utf-8-sig", "utf-7")))
        packed = chance.random() < 0.2
        path = self.folder / f"hostile.csv{'.gz' * packed}"
        path.write_bytes(gzip.compress(content + b"\0" * chance.choice((0, 1 << 24)), 1) if packed else content)
        (self.folder / "hostile.toml").write_bytes((self.folder / "base.toml").read_bytes())
        return self._command(chance, path)

    def _csv_configuration(self, chance: random.Random) -> list[Any]:
        path = self.folder / "hostile.csv"
        path.write_text(self._csv, "utf-8")
        data = tomllib.loads((self.folder / "base.toml").read_text("utf-8"))
        data["columns"] = {"gyro_x": {"from": "gyro_x", "unit": "counts"}}
        path.with_suffix(".toml").write_bytes(self._toml_bytes(data, chance))
        return self._command(chance, path)

    def _toml(self, chance: random.Random) -> list[Any]:
        source = chance.choice(
            [p for kind in ("stations", "tables", "imus", "products") for p in sorted((DATA / kind).glob("*.toml"))]
        )
        path = self.folder / source.parent.name / source.name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(self._toml_bytes(tomllib.loads(source.read_text("utf-8")), chance))
        return ["check", path]

    @staticmethod
    def _toml_bytes(data: dict[str, Any], chance: random.Random) -> bytes:
        try:
            text = tomli_w.dumps(mutate(data, chance))
        except (TypeError, ValueError, RecursionError):  # TOML has no null and no surrogates
            text = tomli_w.dumps({"a": 1})
        insert = chance.choice(
            (
                "",
                "",
                "",
                "a." * 50_000 + "a = 1",
                "a = " + "[" * 50_000,
                "[" * 1000,
                "a = " + "9" * 5000,
                "b = '''",
                "\x00",
            )
        )
        return (insert + "\n" + text).encode("utf-8", "replace") + chance.choice((b"", b"", b"\xff", b"#" * (1 << 21)))

    def _json(self, chance: random.Random) -> list[Any]:
        path = self.folder / "hostile.json"
        result = mutate(json.loads(json.dumps(self._result)), chance, json_only=True)
        text = json.dumps(result)
        text = chance.choice((text, text, text, "[" * 100_000, text[: chance.randrange(len(text))], '{"a":' * 100_000))
        path.write_text(text, "utf-8")
        return chance.choice(
            [
                ["apply", path, self.folder / "base.h5"],
                ["apply", path, self.folder / "base.h5"],
                ["report", path, "-o", self.folder / "out.pdf"],
                ["apply", path, self.folder / "base.csv"],
            ]
        )


def run_limited(arguments: list[str]) -> dict[str, Any]:
    """Run a command in a forked process with limits; return exit code, duration, s, memory, bytes, and its errors."""
    reader, writer = os.pipe()
    started = time.monotonic()
    if (pid := os.fork()) == 0:
        os.close(reader)
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + 2 * MEMORY_LIMIT, used + 2 * MEMORY_LIMIT))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        signal.alarm(6 * TIME_LIMIT)
        os.dup2(writer, 2)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        sys.stdout = open(1, "w", encoding="utf-8", errors="replace", closefd=False)  # noqa: SIM115
        sys.stderr = open(2, "w", encoding="utf-8", errors="replace", closefd=False)  # noqa: SIM115
        code = 70
        try:
            code = run_app(arguments)
            sys.stdout.flush()
            sys.stderr.flush()
        finally:
            os._exit(code)
    os.close(writer)
    with os.fdopen(reader, "rb") as stream:
        errors = stream.read().decode("utf-8", "replace")
    _, status, usage = os.wait4(pid, 0)
    return {
        "code": os.waitstatus_to_exitcode(status),
        "time": time.monotonic() - started,
        "cpu": usage.ru_utime + usage.ru_stime,
        "memory": usage.ru_maxrss * 1024,
        "errors": errors,
    }


def complaint(code: int, errors: str) -> str:
    """Return what is wrong with the end of a command; "" if nothing is."""
    if code not in (0, 1, 2):
        return f"exit code {code}"
    if "nternal error" in errors or "Traceback" in errors or "Warning:" in errors:
        return "internal error"
    if any(ord(char) < 32 and char not in "\n\r\t" for char in errors):
        return "control character"
    return "long message" if any(len(line) > 3000 for line in errors.splitlines()) else ""


def run_here(arguments: list[str]) -> tuple[int, str]:
    """Run a command in this process; return exit code and errors."""
    errors = io.StringIO()
    with redirect_stderr(errors), redirect_stdout(io.StringIO()):
        code = run_app(arguments)
    return code, errors.getvalue()


def main(folder: Path, first: int, count: int) -> int:
    """Open the files of seeds in order, print every failure and the summary; return the number of failures."""
    os.environ["CALSTATION_HOME"] = str(folder / "home")
    files, codes, failures = Files(folder), Counter[int](), 0
    slowest, largest = 0.0, 0
    for seed in range(first, first + count):
        arguments = files.make(seed)
        end = run_limited(arguments)
        codes[end["code"]] += 1
        slowest, largest = max(slowest, end["cpu"]), max(largest, end["memory"])
        wrong = complaint(end["code"], end["errors"])
        wrong = wrong or ("slow" if end["cpu"] > TIME_LIMIT else "large" if end["memory"] > MEMORY_LIMIT else "")
        if wrong:
            failures += 1
            end["errors"] = end["errors"][-600:]
            print(json.dumps({"seed": seed, "wrong": wrong, **end, "arguments": arguments}), flush=True)
    print(json.dumps({"files": count, "codes": codes, "failures": failures, "cpu_s": slowest, "memory": largest}))
    return failures


if __name__ == "__main__":
    sys.exit(min(1, main(Path(sys.argv[3]), int(sys.argv[1]), int(sys.argv[2]))))
