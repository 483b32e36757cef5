"""The virtual bench, which simulates a table and a unit with known true values and real protocols.

It shares parameter names, plan steps and array types with the estimators, but none of their equations.
"""

from calstation.bench.client import BenchClock, BenchHost
from calstation.bench.config import BenchConfig, BenchReport, FaultCommand, FaultName
