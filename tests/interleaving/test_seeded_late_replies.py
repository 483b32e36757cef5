"""Tables and IMUs that reply late, or not at all, at any moment: no reply is taken for the reply to another request."""

import queue
import re
import struct
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from random import Random

import pytest

from calstation.devices.imu import registered_imu, streamed_imu
from calstation.devices.imu.drivers import modbus
from calstation.devices.imu.drivers.modbus import ModbusImu
from calstation.devices.links import (
    ModbusLink,
    ModbusRefusalError,
    TextLink,
    dialogue,
    modbus_link,
    modbus_rtu,
    text_link,
)
from calstation.devices.profiles import SerialSettings, load_table_profile
from calstation.errors import DeviceFaultError
from tests.devices.rtu_server import crc
from tests.devices.test_late_answers import GROUPS, TIMEOUT, pageless
from tests.interleaving.scheduler import Scheduler, failing_seed, run_seeds, with_seeds

#: Number of requests after which the device replies at once again.
UNRELIABLE = 15
#: Delays of replies, s; None for no reply. A line of text has too few forms of replies for a long series of late ones.
DELAYS = (0.0, 0.0, 0.02, TIMEOUT, TIMEOUT + 0.03, 3 * TIMEOUT, None)
TEXT_DELAYS = (0.0, 0.0, 0.0, 0.0, 0.02, TIMEOUT + 0.03, 2 * TIMEOUT, None)
REFUSED = 99
NUMBER = re.compile("^[0-9.]+$")
PROFILE = pageless()
TABLES = Path(__file__).parents[2] / "data" / "tables"


class Line:
    """A line in memory to a device, which replies in the order of the requests; it is used as a `SerialLink`."""

    port = "LINE"

    def __init__(self, random: Random, reply: Callable[[bytes], bytes], delays: Sequence[float | None]) -> None:
        self._random, self._reply, self._delays = random, reply, delays
        self._requests: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._bytes: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self.received_at = 0.0
        threading.Thread(target=self._serve, name="device").start()

    def _serve(self) -> None:
        number = 0
        while True:
            request = self._requests.get()
            number += 1
            late = self._random.choice(self._delays)
            reply = self._reply(request)
            if not 1 < number <= UNRELIABLE:
                late = 0.0
            if late is None:
                continue
            time.sleep(late)
            cut = self._random.randrange(len(reply) + 1)
            for part in (reply[:cut], reply[cut:]):
                if part:
                    self._bytes.put(part)

    def write(self, data: bytes) -> None:
        self._requests.put(data)

    def read(self, wait: float) -> bytes:
        try:
            data = self._bytes.get(wait > 0.0, wait)
        except queue.Empty:
            return b""
        self.received_at = time.monotonic()
        return data

    def close(self) -> None:
        pass


class Registers:
    """The registers of a Modbus unit; register n contains n, and register 99 is refused."""

    def __init__(self) -> None:
        self.words: dict[int, int] = {}

    def reply(self, frame: bytes) -> bytes:
        """Execute a request and return its reply."""
        function, address, second = struct.unpack(">xBHH", frame[:6])
        if address == REFUSED:
            body = bytes([frame[0], function | 0x80, 2])
        elif function == 3:
            words = [self.words.get(address + k, address + k) for k in range(second)]
            body = frame[:2] + struct.pack(f">B{second}H", 2 * second, *words)
        else:
            values = [second] if function == 6 else struct.unpack(f">{second}H", frame[7:-2])
            self.words |= {address + k: value for k, value in enumerate(values)}
            body = frame[:6]
        return body + crc(body)


def recovered(check: Callable[[], bool]) -> None:
    """Check that the link is in order again once no more replies are late."""
    for _ in range(UNRELIABLE):
        time.sleep(10.0)
        with suppress(DeviceFaultError):
            assert check()
            return
    raise AssertionError("the link is not in order again")


def use_modbus_table(seed: int) -> None:
    """Read and write registers of a table; every value is that of its register, and every confirmed write was made."""
    scheduler = Scheduler(seed, (dialogue, modbus_rtu, modbus_link))
    random, device = scheduler.random, Registers()

    def act(link: ModbusLink, number: int) -> None:
        address, count = random.choice((10, 20, 30)), random.choice((1, 2, 4))
        kind = random.choice(("read", "read", "write", "refused"))
        if kind == "read":
            assert link.read(address, count) == [device.words.get(address + k, address + k) for k in range(count)]
        elif kind == "write":
            values = [100 * number + k for k in range(count)]
            link.write(address, values, repeat=random.random() < 0.5)
            assert [device.words[address + k] for k in range(count)] == values
        else:
            try:
                link.read(REFUSED, 1)
            except ModbusRefusalError:
                return
            raise AssertionError("another reply was taken for that of the refused request")

    def main() -> None:
        link = ModbusLink("LINE", 1, TIMEOUT, SerialSettings())
        with suppress(DeviceFaultError):
            link.read(10, 8)  # reads of 8 lengths have distinct replies
        for number in range(1, 12):
            try:
                act(link, number)
            except ModbusRefusalError as error:
                raise AssertionError(f"a refusal was taken for that of another request: {error}") from error
            except DeviceFaultError:
                pass
            time.sleep(random.choice((0.0, 0.05, 1.0)))
        recovered(lambda: link.read(70, 4) == [70, 71, 72, 73])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(modbus_rtu, "SerialLink", lambda *arguments: Line(random, device.reply, DELAYS))
        scheduler.run(main)


def use_imu(seed: int) -> None:
    """Read and write registers of an IMU while samples are read; all values are those of their registers."""
    scheduler = Scheduler(seed, (dialogue, streamed_imu, registered_imu, modbus))
    random, device = scheduler.random, Registers()
    numbers = {f"{group}_{axis}": k + 1.0 for k, group in enumerate(GROUPS) for axis in "xyz"}
    for k, value in enumerate(numbers.values()):
        device.words |= dict(
            zip((address := 100 + 10 * (k // 3) + 2 * (k % 3), address + 1), as_words(value), strict=True)
        )

    def act(imu: ModbusImu, number: int) -> None:
        if random.random() < 0.5:
            changed = dict.fromkeys(random.sample(sorted(numbers), 5), 100.0 + number)
            imu.write_registers(numbers | changed)
            numbers.update(changed)
        assert imu.read_registers() == numbers

    def main() -> None:
        imu = ModbusImu(Line(random, device.reply, DELAYS), PROFILE)

        def read_samples() -> None:
            for _ in range(100):
                imu.read()
                time.sleep(0.5)

        threading.Thread(target=read_samples).start()
        for number in range(3):
            with suppress(DeviceFaultError):
                act(imu, number)
            numbers.update(stored(device, numbers))  # of a transfer that ended in the middle
            time.sleep(random.choice((0.0, 1.0)))
        recovered(lambda: imu.read_registers() == numbers)
        imu.close()

    scheduler.run(main)


def as_words(value: float) -> tuple[int, int]:
    """Return a float32 as two registers."""
    high, low = struct.unpack(">2H", struct.pack(">f", value))
    return high, low


def stored(device: Registers, names: Iterable[str]) -> dict[str, float]:
    """Return the values in the registers of a unit."""
    words = [device.words[100 + 10 * (k // 3) + 2 * (k % 3) + half] for k in range(18) for half in (0, 1)]
    return dict(zip(names, struct.unpack(">18f", struct.pack(">36H", *words)), strict=True))


def use_text_table(seed: int) -> None:
    """Ask a table with lines of text; every reply is that to its line."""
    scheduler = Scheduler(seed, (dialogue, text_link))
    random = scheduler.random
    section = load_table_profile(TABLES / "acutronic_acl.toml").text
    assert section is not None
    section = section.model_copy(update={"timeout_s": TIMEOUT})
    lines = {":Read:Pos? 1": "1.5", ":Read:Pos? 2": "2.5", ":Read:Rate? 1": "3.5", "*IDN?": "ACUTRONIC,1,2"}
    lines |= {":Mode? 1": "POS", ":Mode? 2": "OFF", ":Interlock? 1": "CLOSED", ":Limit:Absolute? 1": "-1,1,0"}
    commands: list[str] = []

    def reply(request: bytes) -> bytes:
        line = request.decode().strip()
        if "?" not in line:
            commands.append(line)
            return b""
        return lines[line].encode() + b"\r\n"

    def act(link: TextLink, number: int) -> None:
        if random.random() < 0.3:
            command = f":Dem:Pos 1,{number}"
            link.command(command, repeat=random.random() < 0.5)
            assert command in commands
        else:
            line = random.choice([line for line in lines if "Read" in line])
            answer = link.ask(line, NUMBER)
            assert answer == lines[line] or not NUMBER.search(answer), "a number of another reply"

    def main() -> None:
        link = TextLink("LINE", section, SerialSettings())
        for number in range(12):
            with suppress(DeviceFaultError):
                act(link, number)
            time.sleep(random.choice((0.0, 0.05, 1.0)))
        recovered(lambda: link.ask(":Read:Pos? 2", NUMBER) == "2.5")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(text_link, "SerialLink", lambda *arguments: Line(random, reply, TEXT_DELAYS))
        scheduler.run(main)


SCENARIOS = {"modbus table": use_modbus_table, "imu": use_imu, "text table": use_text_table}


@pytest.mark.parametrize("name", SCENARIOS)
@with_seeds(10)
def test_late_reply_is_not_taken_for_another_one(name: str, seeds: range) -> None:
    run_seeds(seeds, SCENARIOS[name])


def test_late_identity_is_not_taken_for_the_reply_to_another_query() -> None:
    use_text_table(688)


#: Faults in the links, each of which some seed finds with a scenario.
PLANTED = {
    "any reply is accepted": (dialogue.Dialogue, "_is_synchronised", lambda self, timeout: True, use_modbus_table),
    "late replies are forgotten": (dialogue.Dialogue, "_add", lambda self, transaction: None, use_imu),
    "text is not synchronised": (TextLink, "_synchronise", lambda self: True, use_text_table),
}


@pytest.mark.parametrize("name", PLANTED)
def test_seeds_find_a_fault_of_the_links(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    owner, method, fault, scenario = PLANTED[name]
    monkeypatch.setattr(owner, method, fault)
    assert failing_seed(range(100), scenario) is not None
