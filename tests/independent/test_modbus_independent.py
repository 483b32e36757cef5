"""The Modbus driver is tested with a libmodbus server, and the bench with mbpoll: independent implementations."""

import os
import re
import select
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calstation.devices.links import ModbusLink, ModbusRefusalError
from calstation.devices.profiles import SerialSettings, load_table_profile
from calstation.devices.table import ModbusTable

SOURCE = Path(__file__).with_name("modbus_server.c")
PROFILE = load_table_profile(Path(__file__).parents[2] / "data" / "tables" / "bench.toml").at_station(2.0, None)
DRIVES = Path(__file__).parents[2] / "data" / "tables" / "cia402_drives.toml"
SERIAL = SerialSettings(baud=115200)
needs_mbpoll = pytest.mark.skipif(
    shutil.which("mbpoll") is None, reason="mbpoll is not installed: not tested against it"
)
transports = pytest.mark.parametrize(
    "transport",
    ["tcp", pytest.param("rtu", marks=pytest.mark.skipif(sys.platform == "win32", reason="terminals"))],
)


@pytest.fixture(scope="module")
def server_program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Compile the server; skip the tests if the compiler or the library is missing."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None or shutil.which("pkg-config") is None:
        pytest.skip("no C compiler or pkg-config: not tested against libmodbus")
    flags = subprocess.run(
        ["pkg-config", "--cflags", "--libs", "libmodbus"], capture_output=True, text=True, check=False
    )
    if flags.returncode:
        pytest.skip("libmodbus-dev is not installed: not tested against libmodbus")
    program = tmp_path_factory.mktemp("independent") / "modbus_server"
    command = [
        compiler,
        "-Wall",
        "-Wextra",
        "-Werror",
        "-o",
        str(program),
        str(SOURCE),
        *flags.stdout.split(),
    ]
    built = subprocess.run(command, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    return program


@contextmanager
def crossed_terminals() -> Iterator[tuple[str, str]]:
    """Two pseudo-terminals connected to each other."""
    import tty

    (near, near_slave), (far, far_slave) = os.openpty(), os.openpty()
    for end in (near_slave, far_slave):
        tty.setraw(end)
    closing = threading.Event()

    def carry() -> None:
        while not closing.is_set():
            for source in select.select([near, far], [], [], 0.05)[0]:
                os.write(far if source == near else near, os.read(source, 4096))

    thread = threading.Thread(target=carry, daemon=True)
    thread.start()
    try:
        yield os.ttyname(near_slave), os.ttyname(far_slave)
    finally:
        closing.set()
        thread.join(5.0)
        for end in (near, near_slave, far, far_slave):
            os.close(end)


@contextmanager
def libmodbus(program: Path, transport: str) -> Iterator[str]:
    """Run the server; yield the port for the driver."""
    if transport == "tcp":
        with started([str(program), "tcp"]) as first_line:
            yield f"tcp://127.0.0.1:{first_line}"
        return
    with crossed_terminals() as (theirs, ours), started([str(program), "rtu", theirs]):
        yield ours


@contextmanager
def started(command: list[str]) -> Iterator[str]:
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        yield process.stdout.readline().strip()
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


@transports
def test_driver_exchanges_registers_with_libmodbus(server_program: Path, transport: str) -> None:
    with libmodbus(server_program, transport) as port:
        table = ModbusTable(port, PROFILE, SERIAL)
        try:
            identity = table.identify()
            assert (identity.model, identity.serial) == ("bench-table", "LIBMODBUS-1")
            status = table.status()
            assert (status.enabled, status.homed, status.settled, status.moving) == (
                False,
                False,
                True,
                False,
            )
            assert (status.fault, status.interlock_closed, status.watchdog) == (None, True, 2.0)
            np.testing.assert_allclose(np.rad2deg(status.limits.low), [-1080.0, -1080.0])
            table.enable()
            table.home()
            assert (table.status().enabled, table.status().homed) == (True, True)
            table.heartbeat()
            for outer, inner in ((-90.0, 720.00001), (1079.99999, -1080.0)):
                table.move(*np.deg2rad([outer, inner, 20.0, 40.0]))
                np.testing.assert_allclose(np.rad2deg(table.status().angles), [outer, inner], atol=5e-6)
            table.stop()
            table.reset_fault()
            assert not table.status().enabled
        finally:
            table.close()


@transports
def test_libmodbus_exceptions_are_reported_and_writes_sent_once(server_program: Path, transport: str) -> None:
    with libmodbus(server_program, transport) as port:
        link = ModbusLink(port, 1, 2.0, SERIAL)
        try:
            with pytest.raises(ModbusRefusalError) as caught:
                link.read(60, 10)
            assert caught.value.exception == 2
            for count in (1, 2, 3):
                link.write(23, [7], repeat=False)
                assert link.read(24, 1) == [count]
            link.write(30, list(range(14)))
            assert link.read(30, 14) == list(range(14))
            assert len(link.read(0, 64)) == 64
            link.write(23, [0xDEAD])
            with pytest.raises(ModbusRefusalError) as caught:
                link.read(16, 1)
            assert caught.value.exception == 6
        finally:
            link.close()


def mbpoll(bench: Any, *arguments: str) -> "subprocess.CompletedProcess[str]":
    """Run mbpoll on the bench's table; `arguments` are its options and the values to write."""
    at = bench.endpoints["table"]
    if bench.endpoints["table_transport"] == "tcp":
        host, port = at.split(":")
        where = ["-m", "tcp", "-p", port]
    else:
        host, where = at, ["-m", "rtu", "-b", "115200", "-P", "none"]
    options = [word for word in arguments if not word.startswith("=")]
    values = [word[1:] for word in arguments if word.startswith("=")]
    command = ["mbpoll", *where, "-a", "1", "-0", "-t", "4", "-o", "2", *options, host, *values]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=30)


def polled(bench: Any, first: int, count: int, *options: str) -> list[int]:
    """Return the registers printed by mbpoll."""
    done = mbpoll(bench, "-1", "-r", str(first), "-c", str(count), *options)
    assert done.returncode == 0, done.stdout + done.stderr
    return [int(value) for value in re.findall(r"^\[\d+\]:\s+(-?\d+)", done.stdout, re.MULTILINE)]


@needs_mbpoll
@transports
def test_mbpoll_reads_and_writes_registers_of_the_bench(start_bench: Any, transport: str) -> None:
    with start_bench(table_transport=transport, encoder_sigma_deg=0.0, table_serial="T-42") as bench:
        assert bytes(b for word in polled(bench, 0, 8) for b in word.to_bytes(2, "big")) == b"bench-table".ljust(
            16, b"\0"
        )
        assert polled(bench, 16, 7) == [0, 0x0660, 0, 1, 10_000, 0, 0]
        assert polled(bench, 40, 2, "-t", "4:int", "-B") == [-108_000_000, 108_000_000]
        assert mbpoll(bench, "-r", "22", "=1").returncode == 1, "not enabled: the write is refused"
        assert mbpoll(bench, "-r", "17", "=1").returncode == 1, "read-only"
        assert mbpoll(bench, "-1", "-r", "64").returncode == 1, "beyond the map"
        assert mbpoll(bench, "-r", "20", "=60000").returncode == 0
        for word in ("6", "7", "15"):
            assert mbpoll(bench, "-r", "16", f"={word}").returncode == 0
        assert polled(bench, 17, 1)[0] & 0x6F == 0x27
        assert mbpoll(bench, "-r", "22", "=3").returncode == 0
        bench.advance(6.0)
        assert polled(bench, 17, 1)[0] & 0x1000
        target, rate = 9_000_000, 300_000
        for joint in (34, 54):
            arguments = [f"={value}" for value in (target, rate, rate)]
            assert mbpoll(bench, "-r", str(joint), "-t", "4:int", "-B", *arguments).returncode == 0
        assert mbpoll(bench, "-r", "22", "=1").returncode == 0
        bench.advance(10.0)
        for joint in (30, 50):
            assert polled(bench, joint, 1, "-t", "4:int", "-B")[0] == pytest.approx(target, abs=2000)


@needs_mbpoll
@transports
def test_mbpoll_and_the_driver_agree_on_two_drives(start_bench: Any, transport: str) -> None:
    """Another program reads and writes low-word-first values, floats, a second unit and inverted counts."""
    profile = load_table_profile(DRIVES).at_station(2.0, None)
    with start_bench(table_protocol="drives", table_transport=transport, encoder_sigma_deg=0.0) as bench:
        for unit in ("1", "2"):
            assert polled(bench, 42, 2, "-a", unit, "-t", "4:int") == [-108_000_000, 108_000_000]
            for word in ("6", "7", "15"):
                assert mbpoll(bench, "-a", unit, "-r", "20", f"={word}").returncode == 0
        for unit in ("1", "2"):
            assert mbpoll(bench, "-a", unit, "-r", "23", "=6").returncode == 0
        assert mbpoll(bench, "-a", "1", "-r", "20", "=31").returncode == 0
        bench.advance(6.0)
        arguments = [f"={value}" for value in (9_000_000, 300_000, 300_000)]
        for unit in ("1", "2"):
            assert mbpoll(bench, "-a", unit, "-r", "34", "-t", "4:int", *arguments).returncode == 0
            for address, value in (("23", "=1"), ("20", "=15"), ("20", "=63")):
                assert mbpoll(bench, "-a", unit, "-r", address, value).returncode == 0
        bench.advance(2.0)
        done = mbpoll(bench, "-1", "-a", "2", "-r", "32", "-c", "1", "-t", "4:float")
        speed = float(re.findall(r"^\[\d+\]:\s+(\S+)", done.stdout, re.MULTILINE)[0])
        counts = [polled(bench, 30, 1, "-a", unit, "-t", "4:int")[0] for unit in ("1", "2")]
        at = bench.endpoints["table"]
        table = ModbusTable(f"tcp://{at}" if transport == "tcp" else at, profile)
        try:
            status = table.status()
        finally:
            table.close()
        assert speed > 1.0
        np.testing.assert_allclose(np.rad2deg(status.rates), [speed, -speed], rtol=1e-2)
        np.testing.assert_allclose(np.rad2deg(status.angles), [counts[0] * 1e-5, counts[1] * -1e-5], atol=0.2)
