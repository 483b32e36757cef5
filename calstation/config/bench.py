"""The interface of the virtual bench, which replaces the devices of a station; its settings are only data here."""

from importlib import import_module
from typing import TYPE_CHECKING, Any, Protocol

from pydantic import BaseModel

from calstation import BENCH_MODULE

if TYPE_CHECKING:
    from calstation.config.run_configuration import RunConfiguration


class BenchSettings(Protocol):
    """Meaning of the section `[bench]` of a station file."""

    @property
    def model(self) -> type[BaseModel]:
        """Model of the section, without the `STATION_ENTRIES`."""

    def check(self, setup: "RunConfiguration", where: str) -> None:
        """Check the settings of a station's bench; `where` names them. Raises ConfigurationError."""

    def seed(self, setup: "RunConfiguration") -> int:
        """Return the seed of the bench."""


def load_bench() -> Any:
    """Return the bench of every station with a section `[bench]`.

    It implements `BenchSettings` and the protocols of the packages that open its devices and call its hooks in a run.
    """
    return import_module(BENCH_MODULE).BENCH
