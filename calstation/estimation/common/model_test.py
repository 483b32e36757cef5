"""Tests of the model against the data, and what their failure shows."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Misfit:
    """What a failed test of the model shows: the cause, its size, and what it does to the result."""

    cause: str  #: Code without its family ``cause`` of the message catalogue.
    size: float = math.nan  #: Estimated size, in `unit`; NaN where there is none.
    sigma: float = math.nan  #: Standard deviation of `size`.
    unit: str = "1"  #: SI
    moves: Mapping[str, float] = field(default_factory=dict)  #: Shift of each parameter, in its sigmas, by name.
    values: Mapping[str, Any] = field(default_factory=dict)  #: Further values of the message, JSON values.

    def to_json(self) -> dict[str, Any]:
        """Return the entries of a check in the result JSON."""
        size, sigma = (None if math.isnan(value) else value for value in (self.size, self.sigma))
        entries = {"cause": self.cause, "size": size, "sigma": sigma, "size_unit": self.unit}
        return {**entries, "moves": dict(self.moves), "values": dict(self.values)}

    @classmethod
    def from_json(cls, row: Mapping[str, Any]) -> "Misfit":
        """Read the entries that `to_json` returns from a check in a result JSON."""
        size, sigma = (math.nan if row[key] is None else row[key] for key in ("size", "sigma"))
        return cls(row["cause"], size, sigma, row["size_unit"], row["moves"], row["values"])


@dataclass(frozen=True)
class ModelTest:
    """A test of the model against the data of a stage, and what its failure would mean."""

    kind: str  #: Kind of the check in the result, see `calstation.records.limits.CheckKind`.
    value: float
    limit: float | tuple[float, float]  #: Largest value, or (lowest, highest).
    unit: str
    misfit: Misfit
