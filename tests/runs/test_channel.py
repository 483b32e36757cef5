"""The engine's end of the pipe: events, commands, heartbeats, and lost or frozen listeners."""

import threading
from collections.abc import Iterator
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any

import pytest

from calstation.runs.channel import HEARTBEAT, Channel
from calstation.sequencer import Command, Control, Message, StageProgress, from_json

PATIENCE = 60.0
SILENT_AFTER = 1.0


class Ends:
    """A channel, the end of its listener, and the calls received by the engine."""

    def __init__(self) -> None:
        self.theirs: Connection[Any, Any]
        self.theirs, there = Pipe()
        self.commands: list[Command] = []
        self.heard, self.lost, self.silent = threading.Event(), threading.Event(), threading.Event()
        self.alive = True
        self.ours = Channel(
            there,
            self._command,
            self.lost.set,
            self.silent.set,
            lambda: self.alive,
            silent_after=SILENT_AFTER,
        )

    def _command(self, command: Command) -> None:
        self.commands.append(command)
        self.heard.set()

    def check_cancelled(self) -> Any:
        """Return the next message other than a heartbeat; reply to heartbeats."""
        while (message := self.theirs.recv()) == HEARTBEAT:
            self.theirs.send(HEARTBEAT)
        return message


@pytest.fixture
def ends() -> Iterator[Ends]:
    pair = Ends()
    yield pair
    pair.ours.close()


def test_events_and_commands_pass_through_the_channel(ends: Ends) -> None:
    ends.ours.emit(Message("homing"))
    assert from_json(ends.check_cancelled()) == Message("homing")
    ends.theirs.send("pause")
    ends.ours.emit(StageProgress("rate", 0.5, 1.0))
    ends.check_cancelled()
    assert ends.heard.wait(PATIENCE)
    assert ends.commands == [Command.PAUSE]
    assert not ends.lost.is_set()


def test_a_closed_pipe_is_a_lost_listener(ends: Ends) -> None:
    ends.theirs.close()
    assert ends.lost.wait(PATIENCE)
    ends.ours.emit(Message("homing"))


def test_listener_that_sends_invalid_messages_is_lost(ends: Ends) -> None:
    ends.theirs.send("stopp")
    assert ends.lost.wait(PATIENCE)
    assert ends.commands == []


def test_listener_without_heartbeats_is_frozen_and_may_recover(ends: Ends) -> None:
    assert ends.silent.wait(PATIENCE)
    assert not ends.lost.is_set()
    ends.ours.emit(Message("homing"))
    assert from_json(ends.check_cancelled()) == Message("homing")


@pytest.mark.long
def test_responding_listener_is_not_frozen(ends: Ends) -> None:
    for _ in range(12):
        assert ends.theirs.recv() == HEARTBEAT
        ends.theirs.send(HEARTBEAT)
    assert not ends.silent.is_set()


@pytest.mark.long
def test_blocked_engine_sends_no_heartbeat(ends: Ends) -> None:
    ends.alive = False
    while ends.theirs.poll(SILENT_AFTER):
        assert ends.theirs.recv() == HEARTBEAT
    ends.ours.emit(Message("homing"))
    assert ends.theirs.recv() != HEARTBEAT
    ends.alive = True
    assert ends.theirs.recv() == HEARTBEAT


def test_engine_thread_counts_as_blocked_only_within_its_ticking_section() -> None:
    control = Control()
    assert not control.stuck(-1.0)
    with control.ticking():
        assert control.stuck(-1.0)
        control.take()
        assert not control.stuck(PATIENCE)
    assert not control.stuck(-1.0)
