"""The engine's end of the pipe, with a listener that is slow, freezes or dies at any moment."""

import threading
import time
from collections.abc import Callable

import pytest

from calstation.runs import channel
from calstation.runs.channel import HEARTBEAT, Channel
from calstation.sequencer import Command, Message, from_json
from tests.interleaving.scheduler import Pipe, Scheduler, failing_seed, run_seeds, with_seeds

SILENT_AFTER = 2.0
#: Time allowed for a reaction in addition to its limit, s.
MARGIN = 1.0


class Listener:
    """Replies to heartbeats and sends commands; it freezes or dies at some moment."""

    def __init__(self, scheduler: Scheduler, pipe: Pipe) -> None:
        random = self._random = scheduler.random
        self.pipe, self.received, self.sent = pipe, list[str](), list[Command]()
        self.end = random.choice(("", "freezes", "freezes", "dies"))
        self.end_at = time.monotonic() + random.uniform(0.0, 10.0)

    def run(self) -> None:
        while not (self.end and time.monotonic() >= self.end_at):
            try:
                if not self.pipe.poll(0.2):
                    continue
                message = self.pipe.recv()
                if message == HEARTBEAT:
                    self.pipe.send(HEARTBEAT)
                else:
                    event = from_json(message)
                    assert isinstance(event, Message)
                    self.received.append(event.id)
                if self._random.random() < 0.05:
                    self.sent.append(self._random.choice([*Command]))
                    self.pipe.send(str(self.sent[-1]))
            except (EOFError, OSError):
                return
        if self.end == "dies":
            self.pipe.close()


def connect(seed: int) -> None:
    """Send events to a listener, and check what the engine learns of it, and what arrives."""
    scheduler = Scheduler(seed, (channel,))
    random = scheduler.random
    capacity = random.choice((1, 2, 1000))
    commands: list[Command] = []
    lost: list[float] = []
    silent: list[float] = []
    codes = [f"m{number}" for number in range(random.randrange(5, 40))]
    stuck = (random.uniform(0.0, 5.0), random.uniform(5.0, 15.0)) if random.random() < 0.3 else (0.0, 0.0)

    def main() -> tuple[Listener, float]:
        begin = time.monotonic()
        ours, theirs = Pipe.pair(capacity)
        listener = Listener(scheduler, theirs)
        thread = threading.Thread(target=listener.run, name="listener")
        thread.start()
        made = Channel(
            ours,
            commands.append,
            lambda: lost.append(time.monotonic()),
            lambda: silent.append(time.monotonic()),
            lambda: not stuck[0] <= time.monotonic() - begin <= stuck[1],
            silent_after=SILENT_AFTER,
        )
        for code in codes:
            made.emit(Message(code))
            time.sleep(random.choice((0.0, 0.01, 0.1, 0.1, 1.0)))
        time.sleep(random.choice((0.0, 20.0)))
        closing = time.monotonic()
        made.close()
        assert scheduler.haste or time.monotonic() < closing + channel._FLUSH_TIMEOUT + MARGIN
        thread.join()
        return listener, closing

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(channel, "_MAX_QUEUED", random.choice((10, 10_000)))
        listener, closing = scheduler.run(main)
    assert len(lost) <= 1
    assert listener.received == codes[: len(listener.received)]
    assert commands == listener.sent[: len(commands)]
    if scheduler.haste:  # a timer may end long before a thread that is ready
        return
    if not listener.end:
        assert silent == []
        assert lost or listener.received == codes
    elif listener.end_at + SILENT_AFTER + MARGIN < closing and not stuck[1]:
        assert lost or (listener.end == "freezes" and silent)


@pytest.mark.long
@with_seeds(40)
def test_engine_learns_once_that_its_listener_is_lost_or_frozen(seeds: range) -> None:
    run_seeds(seeds, connect)


def fill_pipe(seed: int) -> None:
    """Fill the pipe of a listener that freezes after its first reply, before the next heartbeat is sent."""
    scheduler = Scheduler(seed, (channel,))
    silent: list[float] = []

    def main() -> None:
        ours, theirs = Pipe.pair(2)
        made = Channel(ours, _ignore, _ignore, lambda: silent.append(time.monotonic()), lambda: True, SILENT_AFTER)
        assert theirs.recv() == HEARTBEAT
        theirs.send(HEARTBEAT)
        time.sleep(0.05)
        for number in range(9):
            made.emit(Message(f"m{number}"))
        time.sleep(SILENT_AFTER + MARGIN)

    scheduler.run(main)
    assert silent or scheduler.haste


def fill_queue(seed: int) -> None:
    """Close a channel whose pipe and queue are full, because its listener reads nothing."""
    scheduler = Scheduler(seed, (channel,))

    def main() -> None:
        ours, _ = Pipe.pair(1)
        made = Channel(ours, _ignore, _ignore, _ignore, lambda: True)
        time.sleep(0.05)
        for number in range(4):
            made.emit(Message(f"m{number}"))
            time.sleep(0.01)
        closing = time.monotonic()
        made.close()
        assert scheduler.haste or time.monotonic() < closing + channel._FLUSH_TIMEOUT + MARGIN

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(channel, "_MAX_QUEUED", 3)
        scheduler.run(main)


@pytest.mark.parametrize("scenario", [fill_pipe, fill_queue])
def test_listener_that_freezes_with_a_full_pipe_is_noticed_and_delays_no_end(scenario: Callable[[int], None]) -> None:
    run_seeds(range(30), scenario)


def _ignore(*arguments: object) -> None:
    pass


def _report_unlocked(self: Channel) -> None:
    """Report a lost listener as if only one thread noticed it."""
    if not self._lost.is_set() and not self._closing:
        self._lost.set()
        self._on_lost()


def _close_patiently(self: Channel) -> None:
    """Close the channel as if its queue always had space."""
    self._closing = True
    if not self._lost.is_set():
        self._queue.put(None)
        self._sender.join(channel._FLUSH_TIMEOUT)
    self._connection.close()


#: Faults in the channel, each of which some seed finds with a scenario.
PLANTED = {
    "lost twice": ("_report_loss", _report_unlocked, connect),
    "a full queue": ("close", _close_patiently, fill_queue),
    "a full pipe": ("_transmit", lambda self, message: self._connection.send(message), fill_pipe),
}


@pytest.mark.long
@pytest.mark.parametrize("name", PLANTED)
def test_seeds_find_a_fault_of_the_channel(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    method, fault, scenario = PLANTED[name]
    monkeypatch.setattr(Channel, method, fault)
    assert failing_seed(range(300), scenario) is not None
