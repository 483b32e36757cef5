"""The scheduler repeats an order of threads by its seed, and finds deadlocks and races."""

import queue
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from tests.interleaving import test_scheduler as this
from tests.interleaving.scheduler import DeadlockError, Scheduler, failing_seed


def order(seed: int) -> tuple[list[tuple[int, int]], float]:
    """Return the order in which a queue passes numbers of two threads, and the virtual time at the end."""

    def main() -> tuple[list[tuple[int, int]], float]:
        numbers: queue.Queue[tuple[int, int]] = queue.Queue(2)

        def put(thread: int) -> None:
            for number in range(4):
                numbers.put((thread, number))
                time.sleep(1.0)

        with ThreadPoolExecutor(2) as executor:
            jobs = [executor.submit(put, thread) for thread in range(2)]
            passed = [numbers.get(timeout=60.0) for _ in range(8)]
        assert [job.result() for job in jobs] == [None, None]
        return passed, time.monotonic()

    return Scheduler(seed).run(main)


def test_seed_determines_the_order() -> None:
    orders = [order(seed) for seed in range(20)]
    assert orders == [order(seed) for seed in range(20)]
    assert len({tuple(passed) for passed, _ in orders}) > 2
    assert all(end >= 1004.0 for _, end in orders)


def test_deadlock_names_where_each_thread_waits() -> None:
    def scenario(seed: int) -> None:
        def main() -> None:
            one, other = threading.Lock(), threading.Lock()

            def lock(first: threading.Lock, second: threading.Lock) -> None:
                with first, second:
                    pass

            threads = [threading.Thread(target=lock, args=locks) for locks in ((one, other), (other, one))]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()

        Scheduler(seed).run(main)

    seed = failing_seed(range(50), scenario)
    assert seed is not None
    with pytest.raises(DeadlockError, match=r"(?s)main:.*thread\.join\(\).*lock:.*with first, second"):
        scenario(seed)


def test_race_between_two_lines_is_found() -> None:
    def scenario(seed: int) -> None:
        counter = Counter()

        def main() -> None:
            with ThreadPoolExecutor(2) as executor:
                for job in [executor.submit(counter.count) for _ in range(2)]:
                    job.result()

        Scheduler(seed, (this,)).run(main)
        assert counter.value == 2

    assert failing_seed(range(50), scenario) is not None


class Counter:
    """A counter without a lock."""

    value = 0

    def count(self) -> None:
        value = self.value
        self.value = value + 1
