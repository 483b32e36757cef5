"""What sort of unit a set of registers is of, as the journal notes it."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from calstation.config.resolved import ResolvedConfiguration
from calstation.devices.profiles.registers import RegisterEntry

#: Of a register's entry, what leaves the meaning of its content as it is.
_MEANS_NOTHING = {"tolerance", "range"}


@dataclass(frozen=True)
class UnitSort:
    """Model of a unit, and the profile and product that it was written by; "" where nobody noted it.

    Attributes
    ----------
    model : as the unit answered
    profile, product : names
    map : digest of the profile's registers, as far as they say what a content means
    """

    model: str = ""
    profile: str = ""
    product: str = ""
    map: str = ""

    @classmethod
    def of(cls, setup: ResolvedConfiguration, model: str) -> "UnitSort":
        """Of a unit that answers with `model` and is written as `setup` has it."""
        return cls(model, setup.imu.name, setup.product.name, map_digest(setup.imu.registers))

    @classmethod
    def noted(cls, content: Mapping[str, Any]) -> "UnitSort":
        """What a line of the journal says."""
        return cls(**{field.name: str(content.get(field.name, "")) for field in fields(cls)})

    def to_json(self) -> dict[str, str]:
        """As plain values."""
        return asdict(self)


def map_digest(registers: list[RegisterEntry]) -> str:
    """The same for registers whose contents mean the same."""
    rows = sorted(
        json.dumps(entry.model_dump(mode="json", exclude=_MEANS_NOTHING), sort_keys=True)
        for entry in registers
    )
    return hashlib.sha256("\n".join(rows).encode()).hexdigest()[:16]
