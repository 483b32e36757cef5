"""Messages of another process are read without waiting for the rest of an incomplete message."""

import os
import signal
import struct
import sys
import threading
import time
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from queue import Empty
from typing import Any

import pytest

from calstation.jobs import ChildProcess
from calstation.jobs.process import PipeReader
from calstation.runs import Engine
from calstation.sequencer import Event, Fault, Message, to_json

PATIENCE = 60.0


def freeze_in_mid_message(there: "Connection[Any, Any]") -> None:
    """Send a message, start another of one megabyte, and freeze."""
    there.send(to_json(Message("homing")))
    os.write(there.fileno(), struct.pack("!i", 1 << 20) + bytes(100_000))
    os.kill(os.getpid(), signal.SIGSTOP)


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="SIGSTOP exists only on POSIX systems")
def test_engine_frozen_within_a_message_does_not_block_the_reader() -> None:
    engine = Engine(ChildProcess("frozen", freeze_in_mid_message))
    events: list[Event] = []
    deadline = time.monotonic() + PATIENCE
    while not any(isinstance(event, Fault) for event in events):
        assert time.monotonic() < deadline
        events += engine.poll()  # would never return where it waited for the rest
        time.sleep(0.02)
    first, fault = events
    assert first == Message("homing")
    assert isinstance(fault, Fault)
    assert fault.code == "run.engine_silent"
    engine.stop_listening()
    engine.process.join(PATIENCE)
    assert not engine.alive


def next_letter(mailbox: PipeReader) -> Any:
    return mailbox.take(PATIENCE)


def test_messages_arrive_complete_and_in_order_until_the_end() -> None:
    here, there = Pipe()
    mailbox = PipeReader(here)
    with pytest.raises(Empty):
        mailbox.take()
    sent: list[Any] = ["beat", {"event": "x" * 3_000_000}, [1, 2]]
    writer = threading.Thread(target=lambda: ([there.send(message) for message in sent], there.close()))
    writer.start()
    assert [next_letter(mailbox) for _ in sent] == sent
    writer.join(PATIENCE)
    for _ in range(2):
        with pytest.raises(EOFError):
            next_letter(mailbox)
    mailbox.close()
    with pytest.raises(OSError, match="closed"):
        here.fileno()


def test_closed_connection_is_detected_at_the_other_end_without_a_read() -> None:
    here, there = Pipe()
    mailbox = PipeReader(here)
    end = threading.Event()

    def talk() -> None:
        try:
            while True:
                there.send("x" * 10_000)
        except OSError:
            end.set()

    writer = threading.Thread(target=talk, daemon=True)
    writer.start()
    assert next_letter(mailbox).startswith("x")
    mailbox.close()
    assert end.wait(PATIENCE)
    there.close()
