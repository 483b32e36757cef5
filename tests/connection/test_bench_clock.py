"""The clock of the virtual bench reports rejected requests and returns to each thread its own response."""

import json
from concurrent.futures import ThreadPoolExecutor

from calstation.bench import BenchClock
from calstation.errors import DeviceFaultError
from tests.connection.fake_links import server
from tests.helpers import raises_code


def clock_at(address: str) -> BenchClock:
    host, _, port = address.rpartition(":")
    return BenchClock((host, int(port)), 0.0)


def test_rejected_request_is_a_fault() -> None:
    with server(lambda asked: b'{"now": 0.0}\n' if b"now" in asked else b'{"error": "no such order"}\n') as address:
        clock = clock_at(address)
        with raises_code(DeviceFaultError, "connection.bench_refused") as caught:
            clock.inject({"order": "dance"})
        assert "no such order" in str(caught.value)
        for refused in (lambda: clock.sleep(1.0), lambda: clock.carry(0.0, 0.0, 1.0)):
            with raises_code(DeviceFaultError, "connection.bench_refused"):
                refused()
        clock.close()


def test_each_thread_gets_the_response_to_its_own_request() -> None:
    def answer(asked: bytes) -> bytes:
        return json.dumps({"now": 0.0, "error": json.loads(asked).get("order")}).encode() + b"\n"

    def refused(number: int) -> str:
        with raises_code(DeviceFaultError, "connection.bench_refused") as caught:
            clock.inject({"order": f"order {number}."})
        return str(caught.value)

    with server(lambda asked: b'{"now": 0.0}\n' if b"now" in asked else answer(asked)) as address:
        clock = clock_at(address)
        with ThreadPoolExecutor(8) as threads:
            answers = list(threads.map(refused, range(200)))
        clock.close()
    assert all(f"order {number}." in text for number, text in enumerate(answers))
