"""The bench process: Modbus clients, the serial line, its clock, and its exit with its parent."""

import json
import socket
import struct
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from pymodbus.client import ModbusSerialClient, ModbusTcpClient

from calstation.bench.imu.unit import STREAM

posix = pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals")


def connect(bench):
    endpoint = bench.endpoints["table"]
    if bench.endpoints["table_transport"] == "tcp":
        host, port = endpoint.split(":")
        client = ModbusTcpClient(host, port=int(port), timeout=2.0, retries=0)
    else:
        client = ModbusSerialClient(endpoint, baudrate=115200, timeout=2.0, retries=0)
    assert client.connect()
    return client


def words(*values):
    return [word for value in values for word in struct.unpack(">HH", struct.pack(">i", value))]


def read(client, address, count=1):
    response = client.read_holding_registers(address, count=count, device_id=1)
    assert not response.isError()
    return response.registers


def write(client, address, *values):
    """Write registers; return the Modbus exception code, or 0 on success."""
    if len(values) == 1:
        response = client.write_register(address, values[0], device_id=1)
    else:
        response = client.write_registers(address, list(values), device_id=1)
    return response.exception_code if response.isError() else 0


def enable_and_home(bench, client):
    for word in (0x06, 0x07, 0x0F):
        assert write(client, 16, word) == 0
    assert write(client, 22, 3) == 0
    bench.advance(6.0)
    assert read(client, 17)[0] & 0x1000


@pytest.mark.parametrize("transport", ["tcp", pytest.param("rtu", marks=posix)])
def test_modbus_client_reads_and_writes_the_register_map(start_bench, transport):
    with start_bench(table_transport=transport, table_serial="T-42", encoder_sigma_deg=0.0) as bench:
        client = connect(bench)
        try:
            identity = struct.pack(">16H", *read(client, 0, 16))
            assert identity == b"bench-table".ljust(16, b"\0") + b"T-42".ljust(16, b"\0")
            assert read(client, 16, 7) == [0, 0x0660, 0, 1, 10_000, 0, 0]
            assert read(client, 40, 4) == words(-108_000_000, 108_000_000)
            assert write(client, 22, 1) == 4  # not enabled
            assert write(client, 17, 1) == 2  # read-only
            assert write(client, 64, 1) == 2  # beyond the map
            enable_and_home(bench, client)
            assert write(client, 34, *words(9_000_000, 300_000, 600_000)) == 0
            assert write(client, 54, *words(-4_500_000, 300_000, 600_000)) == 0
            assert write(client, 22, 1) == 0
            assert read(client, 22) == [0]
            for _ in range(5):
                bench.advance(1.0)
                assert write(client, 21, 1) == 0
            status = read(client, 17)[0]
            assert status & 0x5427 == 0x1427
            outer, inner = read(client, 30, 2), read(client, 50, 2)
            assert struct.unpack(">i", struct.pack(">HH", *outer))[0] == pytest.approx(9_000_000, abs=800)
            assert struct.unpack(">i", struct.pack(">HH", *inner))[0] == pytest.approx(-4_500_000, abs=800)
            assert write(client, 34, *words(108_000_001)) == 0
            assert write(client, 22, 1) == 3  # beyond the cable's travel
            assert write(client, 22, 9) == 3
        finally:
            client.close()


def test_watchdog_and_interlock_trip_and_latch_faults(start_bench):
    with start_bench(watchdog_ms=800) as bench:
        client = connect(bench)
        try:
            enable_and_home(bench, client)
            deadline = time.monotonic() + 20.0
            while read(client, 17)[0] & 0x0F != 0x08:  # reading does not feed the watchdog
                assert time.monotonic() < deadline
                time.sleep(0.05)
            assert read(client, 18) == [2]
            assert write(client, 22, 3) == 4
            assert write(client, 20, 0) == 0
            assert write(client, 16, 0x80) == 0
            assert read(client, 18) == [0]
            for word in (0x06, 0x07, 0x0F):
                write(client, 16, word)
            bench.ask(order="interlock", value=0)
            assert read(client, 18, 2) == [1, 0]
            assert write(client, 22, 3) == 4
            assert write(client, 16, 0x80) == 0
            assert read(client, 18) == [1]
        finally:
            client.close()


@pytest.mark.parametrize("transport", ["socket", pytest.param("pty", marks=posix)])
def test_serial_line_loses_no_bytes_and_replies_while_streaming(start_bench, imu_client, transport):
    with start_bench(imu_transport=transport, serial="SN-77", clock_drift_ppm=0.0) as bench:
        imu = imu_client(bench.endpoints["imu"])
        assert imu.command(1) == (1, b"bench-imu;SN-77;1.0.0")  # the bench has detected the open line
        answer = bench.advance(20.0)
        values = struct.pack("<HB3f", 12, 3, 0.5, -1.5, 2.5)
        assert imu.command(3, values) == (3, values[:3])
        assert imu.command(2, values[:3]) == (2, values)
        total = bench.advance(20.0)
        imu.wait_for(total["bytes"][0])
        assert answer["now"] == pytest.approx(20.0)
        assert total["samples"] == 8000
        assert len(imu.data) == total["bytes"][0]
        # Without the three replies, only complete frames remain, and none is missing.
        first, replies = 6 + 21, 6 + 3 + 6 + 15
        frames = len(imu.data) - first - replies
        assert frames % STREAM.itemsize == 0
        before = np.frombuffer(bytes(imu.data[first : answer["bytes"][0]]), dtype=STREAM)["counter"]
        after = np.frombuffer(bytes(imu.data[answer["bytes"][0] + replies :]), dtype=STREAM)["counter"]
        assert np.array_equal(np.concatenate([before, after]), np.arange(8000 - 20))


def test_slow_reader_pauses_the_clock_and_no_data_is_lost(start_bench, imu_client):
    with start_bench(sample_rate_hz=1000.0, clock_drift_ppm=0.0) as bench:
        host, port = bench.endpoints["imu"].removeprefix("socket://").split(":")
        with socket.create_connection((host, int(port))) as reader:
            bench.ask(now=None)
            bench.clock.sendall(b'{"advance": 300}\n')
            bench.clock.settimeout(0.5)
            with pytest.raises(TimeoutError):
                bench.clock.recv(1)
            bench.clock.settimeout(20.0)
            size, expected = 0, (300_000 - 100) * STREAM.itemsize
            while size < expected:
                size += len(reader.recv(65536))
            bench.clock.recv(200)


def test_simulated_time_follows_host_time_at_the_configured_speed(start_bench):
    with start_bench(speed=20.0, clock_drift_ppm=0.0) as bench:
        begun, first = time.monotonic(), bench.ask(now=None)["now"]
        last = bench.advance(10.0)
        took = time.monotonic() - begun
        assert last["now"] - first >= 10.0
        assert 0.45 < took < 3.0
        assert last["samples"] == pytest.approx(last["now"] * 200.0, abs=1.01)


def test_bench_configured_too_fast_for_the_computer_still_responds(start_bench):
    with start_bench(speed=1e5) as bench:
        client = connect(bench)
        for word in (0x06, 0x07, 0x0F):
            assert write(client, 16, word) == 0
        begun = bench.ask(now=None)["now"]
        while bench.ask(now=None)["now"] < begun + 30.0:
            assert not read(client, 18)[0], "the watchdog counts the host's time, and is fed in it"
        client.close()


def test_invalid_request_gets_an_error_response(start_bench):
    with start_bench() as bench:
        assert "error" in bench.ask(order="sing")
        assert "error" in bench.ask(retreat=1.0)
        assert bench.advance(0.5)["samples"] == 100


def test_bench_exits_when_its_standard_input_closes(start_bench):
    with start_bench() as bench:
        bench.process.stdin.close()
        assert bench.process.wait(5.0) == 0


def test_bench_exits_when_its_clock_connection_closes(start_bench):
    with start_bench() as bench:
        bench._lines.close()
        bench.clock.close()
        assert bench.process.wait(5.0) == 0


@posix
def test_bench_exits_when_its_parent_is_killed():
    script = (
        "import subprocess, sys, time\n"
        "p = subprocess.Popen([sys.executable, '-m', 'calstation.bench'], stdin=subprocess.PIPE,"
        " stdout=subprocess.PIPE)\n"
        "p.stdout.readline(); print(p.pid, flush=True); time.sleep(60)\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE)
    pid = int(parent.stdout.readline())
    parent.kill()
    parent.wait()
    parent.stdout.close()
    for _ in range(100):
        if not alive(pid):
            return
        time.sleep(0.05)
    raise AssertionError("the bench still runs")


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.long
@pytest.mark.parametrize(
    ("config", "message"),
    [
        ('{"grade": "toy"}', "grade"),
        pytest.param("[1]", "configuration", marks=pytest.mark.exhaustive),
        pytest.param("nowhere.json", "nowhere.json", marks=pytest.mark.exhaustive),
        pytest.param("{", "bench", marks=pytest.mark.exhaustive),
    ],
)
def test_invalid_configuration_is_reported_in_one_line(config, message):
    run = subprocess.run(
        [sys.executable, "-m", "calstation.bench", "--config", config],
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 2
    assert message in run.stderr
    assert "Traceback" not in run.stderr
    assert len(run.stderr.strip().splitlines()) == 1


def test_watchdog_stops_a_bench_without_clients_and_is_reported(start_bench, tmp_path):
    """Without clients, time does not advance, so the bench itself simulates the deceleration."""
    report = tmp_path / "report.json"
    with start_bench(report_file=str(report), watchdog_ms=300, start_deg=[0.0, 0.0]) as bench:
        client = connect(bench)
        for word in (0x06, 0x07, 0x0F):
            client.write_register(16, word, device_id=1)
        client.write_register(22, 3, device_id=1)
        bench.advance(1.0)
        client.write_registers(34, words(9_000_000, 200_000, 200_000), device_id=1)
        client.write_register(22, 1, device_id=1)
        bench.advance(0.5)
        client.close()
    left = json.loads(report.read_text(encoding="utf-8"))
    assert (left["enabled"], left["moving"], left["fault"]) == (False, False, "WATCHDOG")


@posix
def test_reconnected_adapter_has_a_new_port_name(start_bench, imu_client):
    with start_bench(imu_transport="pty", serial="SN-77") as bench:
        before = imu_client(bench.endpoints["imu"])
        assert before.command(1) == (1, b"bench-imu;SN-77;1.0.0")
        bench.ask(order="hang_up_imu")
        now = json.loads(bench.process.stdout.readline())
        assert now["imu"] != bench.endpoints["imu"]
        assert {k: v for k, v in now.items() if k != "imu"} == {k: v for k, v in bench.endpoints.items() if k != "imu"}
        before.wait_for_the_end()
        after = imu_client(now["imu"])
        assert after.command(1) == (1, b"bench-imu;SN-77;1.0.0")
        after.wait_for(bench.advance(1.0)["bytes"][0])
        assert len(after.data) > 100 * STREAM.itemsize
