"""The virtual bench: a simulated table and unit with known true values and the real protocols.

It shares only parameter names, steps of a plan and array types with the estimators, and none of their equations.
"""

from calstation.bench.client import BenchClock, BenchHost
from calstation.bench.config import BenchConfig, BenchReport, Order, OrderName
