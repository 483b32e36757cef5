"""Driver of an IMU whose samples and command replies come as binary frames on one serial link."""

import struct
import time
from collections.abc import Mapping

from calstation.devices.frames import Reply, command_frame
from calstation.devices.imu_profile import ImuProfile
from calstation.devices.interfaces import ImuIdentity, OtherModelError
from calstation.devices.link import SerialLink
from calstation.devices.registers import RegisterMap
from calstation.devices.streamed_imu import ImuRefusalError, StreamedImu
from calstation.errors import DeviceFaultError

OP_IDENTIFY, OP_READ, OP_WRITE, OP_COMMIT, OP_RESET, OP_STREAM, OP_ERROR = 1, 2, 3, 4, 5, 6, 0xFF
_ERRORS = {1: "unknown command", 2: "no such register", 3: "flash busy"}
_ATTEMPTS = 3
_VALUES_PER_TRANSFER = 32


class FramedImu(StreamedImu):
    """The IMU of a profile on a link; one thread owns the port, reads samples and sends commands.

    Parameters
    ----------
    link : open port
    profile : what the bytes mean
    """

    def __init__(self, link: SerialLink, profile: ImuProfile) -> None:
        assert profile.commands is not None
        super().__init__(link, profile, profile.commands)
        self._commands = profile.commands
        self._registers = RegisterMap(tuple(profile.registers))

    def start(self) -> None:
        """Switch the stream on."""
        self._ask(OP_STREAM, b"\x01")

    def identify(self) -> ImuIdentity:
        """Ask for model, serial number and firmware; raises OtherModelError where another model answers."""
        text = self._ask(OP_IDENTIFY, b"").decode("ascii", errors="replace")
        parts = [part.strip() for part in text.split(";")]
        if len(parts) != 3:
            raise OtherModelError(
                f"IMU: identity '{text}' is not 'model;serial;firmware'; choose another profile",
                text,
                "model;serial;firmware",
            )
        identity = ImuIdentity(*parts)
        if self._profile.model not in identity.model:
            raise OtherModelError(
                f"IMU: model '{identity.model}' answers, the profile is for '{self._profile.model}';"
                " choose the right IMU profile in the product file",
                identity.model,
                self._profile.model,
            )
        return identity

    def read_registers(self) -> dict[str, float]:
        """Calibration registers in SI by parameter."""
        return self._registers.decode(
            {e.address: self._read_values(e.address, len(e.parameters)) for e in self._registers.entries}
        )

    def write_registers(self, values: Mapping[str, float]) -> None:
        """Write calibration registers; parameters not named keep theirs."""
        missing = [name for name in self._registers.parameters if name not in values]
        present = self.read_registers() if missing else {}
        for address, row in self._registers.encode({**present, **values}).items():
            for k in range(0, len(row), _VALUES_PER_TRANSFER):
                part = row[k : k + _VALUES_PER_TRANSFER]
                head = struct.pack(self._format("HB"), address + k, len(part))
                answer = self._ask(OP_WRITE, head + struct.pack(self._format(f"{len(part)}f"), *part), head)
                if answer != head:
                    raise DeviceFaultError(
                        f"IMU: register {address + k} was not taken; nothing was committed"
                    )

    def commit(self) -> None:
        """Write the registers to flash, once: a lost answer is a fault, never a second flash cycle."""
        answer = self._ask(OP_COMMIT, b"", attempts=1)
        if answer[:1] != b"\x00":
            raise DeviceFaultError(
                "IMU: the unit refused to commit its registers; power it off and on, try again"
            )

    def reset(self) -> None:
        """Restart the unit and wait until it answers again."""
        self._ask(OP_RESET, b"", attempts=1)
        deadline = time.monotonic() + self._commands.reset_timeout_s
        while True:
            try:
                self._ask(OP_IDENTIFY, b"", attempts=1)
                return
            except DeviceFaultError:
                if self.lost or time.monotonic() > deadline:
                    raise

    def _read_values(self, address: int, count: int) -> list[float]:
        values: list[float] = []
        for k in range(0, count, _VALUES_PER_TRANSFER):
            n = min(_VALUES_PER_TRANSFER, count - k)
            head = struct.pack(self._format("HB"), address + k, n)
            answer = self._ask(OP_READ, head, head)
            if len(answer) != len(head) + 4 * n:
                raise DeviceFaultError(f"IMU: register {address + k} answers with a wrong length")
            values += struct.unpack(self._format(f"{n}f"), answer[len(head) :])
        return values

    def _format(self, codes: str) -> str:
        return ("<" if self._profile.frame.byte_order == "little" else ">") + codes

    def _ask(self, op: int, payload: bytes, begins: bytes = b"", attempts: int = _ATTEMPTS) -> bytes:
        """Send a command and wait for its reply, whose payload must begin with `begins`."""

        def take(reply: Reply) -> bytes | None:
            if reply.op == OP_ERROR:
                code = reply.payload[0] if reply.payload else 0
                raise ImuRefusalError(f"IMU: command {op} was refused: {_ERRORS.get(code, f'code {code}')}")
            return reply.payload if reply.op == op and reply.payload.startswith(begins) else None

        request = command_frame(self._commands, self._profile.frame, op, payload)
        return self.exchange(request, take, timeout=self._commands.timeout_s, attempts=attempts)
