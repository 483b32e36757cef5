"""The clock of the virtual bench reports what the bench refuses."""

from calstation.connection.clock import BenchClock
from calstation.errors import DeviceFaultError
from tests.connection.fake_links import server
from tests.helpers import raises_code


def clock_at(address: str) -> BenchClock:
    host, _, port = address.rpartition(":")
    return BenchClock((host, int(port)), 0.0)


def test_a_refused_request_is_a_fault() -> None:
    with server(lambda asked: b'{"now": 0.0}\n' if b"now" in asked else b'{"error": "no such order"}\n') as address:
        clock = clock_at(address)
        with raises_code(DeviceFaultError, "connection.bench_refused") as caught:
            clock.order({"order": "dance"})
        assert "no such order" in str(caught.value)
        for refused in (lambda: clock.sleep(1.0), lambda: clock.carry(0.0, 0.0, 1.0)):
            with raises_code(DeviceFaultError, "connection.bench_refused"):
                refused()
        clock.close()
