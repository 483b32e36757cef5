"""The protocol Simserv: requests have fields separated by 0xB6 and end with CR; replies begin with a status code."""

from collections.abc import Callable

from calstation.bench.chamber.machine import ChamberMachine

MODEL = "bench-chamber"

_SEPARATOR = b"\xb6"
_DONE, _UNKNOWN, _WRONG = "1", "-5", "-6"
#: Bits of the state: always set, running, alarm.
_READY, _RUNNING, _ALARM = 1, 2, 8


class Simserv:
    """The server, which ignores the next `ignored_requests` requests."""

    def __init__(self, machine: ChamberMachine) -> None:
        self._machine = machine
        self.ignored_requests = 0

    def new_parser(self) -> Callable[[bytes], list[bytes]]:
        """Return a parser for one connection, which converts received bytes to replies."""
        pending = b""

        def parse(data: bytes) -> list[bytes]:
            nonlocal pending
            *requests, pending = (pending + data).split(b"\r")
            replies = [self._reply(request) for request in requests]
            muted = min(self.ignored_requests, len(replies))
            self.ignored_requests -= muted
            return [b""] * muted + replies[muted:]

        return parse

    def _reply(self, request: bytes) -> bytes:
        command, _, *arguments = [field.decode("ascii", "replace") for field in request.split(_SEPARATOR)] + [""]
        try:
            fields = self._execute(command, [float(text) for text in arguments if text])
        except (ValueError, IndexError):
            fields = [_WRONG]
        return _SEPARATOR.join(field.encode() for field in fields) + b"\r\n"

    def _execute(self, command: str, arguments: list[float]) -> list[str]:
        machine = self._machine
        match command:
            case "11001":
                machine.set_point = arguments[1]
            case "14001":
                (machine.start if arguments[1] else machine.stop)()
            case "11004":
                return [_DONE, f"{machine.temperature:.2f}"]
            case "11002":
                return [_DONE, f"{machine.set_point:.2f}"]
            case "14003":
                return [_DONE, f"{int(machine.running)}"]
            case "15002":
                return [_DONE, f"{int(machine.door_open)}"]
            case "10012":
                state = _READY | _RUNNING * machine.running | _ALARM * (machine.alarm != 0)
                return [_DONE, f"{state}"]
            case "99997":
                return [_DONE, MODEL]
            case _:
                return [_UNKNOWN]
        return [_DONE]
