"""The loss of a whole counter period is invisible in the counter but is detected by the station clock."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from calstation.devices import SampleBatch
from calstation.devices.imu import SampleCount
from calstation.devices.profiles import FrameSection
from calstation.estimation.common import SampleBlock
from calstation.sequencer.acquisition import Acquisition, SampleTags
from tests.sequencer.fakes import RATE, UNIT, FakeClock, FakeImu, FakeTable

FRAME = FrameSection.model_validate(
    {
        "sync": "C0",
        "byte_order": "big",
        "fields": [{"name": "counter", "type": "u8"}],
        "crc": {"kind": "sum8", "start": 0},
    }
)
TICK = 0.05


@dataclass
class ShortCounter(FakeImu):
    """The fake unit with an 8-bit counter; samples arrive with a delay of `late` s."""

    count: SampleCount = field(default_factory=lambda: SampleCount(FRAME))
    late: float = 0.0

    def read(self) -> SampleBatch:
        moment, self.clock.time = self.clock.time, max(self.sent / RATE, self.clock.time - self.late)
        batch = super().read()
        self.clock.time = moment
        seq = self.count.feed(batch.seq % 256)
        return replace(batch, seq=seq, time=(seq + 1) / RATE)


class Line:
    """A unit that is read every tick, with its received samples."""

    def __init__(self) -> None:
        self.clock = FakeClock()
        self.imu = ShortCounter(self.clock, FakeTable(self.clock))
        self.blocks: list[SampleBlock] = []
        self.acquisition = Acquisition(
            self.imu, replace(UNIT, wrap=FRAME.counter_period), self.clock, SampleTags(), self.blocks.append
        )
        self.pass_(3.0)

    def pass_(self, seconds: float) -> int:
        """Advance time and return the number of missed samples."""
        missing = 0
        for _ in range(round(seconds / TICK)):
            self.clock.sleep(TICK)
            missing += self.acquisition.drain().missing
        return missing

    def lose(self, samples: int) -> None:
        """Lose all samples for this time."""
        self.clock.sleep(samples / RATE)
        self.imu.sent += samples

    @property
    def steps(self) -> list[int]:
        """Return the counter increments other than one."""
        steps = np.diff(np.concatenate([block.seq for block in self.blocks]))
        return [int(step) for step in steps if step != 1]


@pytest.mark.parametrize("lost", [5, 100, 255, 256, 300, 512, 3 * 256 + 40])
def test_any_number_of_lost_samples_is_counted(lost: int) -> None:
    line = Line()
    line.lose(lost)
    assert line.pass_(10.0) == lost
    assert line.steps == [lost + 1]
    assert line.acquisition.gaps == 1


def test_every_lost_wrap_is_counted_once() -> None:
    line = Line()
    for _ in range(3):
        line.lose(256)
        assert line.pass_(3.0) == 256
    assert line.steps == [257] * 3


def test_busy_computer_does_not_cause_lost_samples() -> None:
    line = Line()
    line.clock.sleep(2.56)
    assert line.pass_(5.0) == 0
    assert line.steps == []


def test_delayed_samples_are_not_counted_as_lost() -> None:
    line = Line()
    for late in (0.5, 1.0, 2.0, 0.0):
        line.imu.late = late
        line.pass_(5.0)
    assert line.steps == []


def test_time_continues_with_the_counter() -> None:
    line = Line()
    line.lose(256)
    line.pass_(1.0)
    seq, time = (np.concatenate([getattr(b, name) for b in line.blocks]) for name in ("seq", "time"))
    assert np.allclose(np.diff(time), np.diff(seq) / RATE)
