"""The virtual bench, a simulated table and unit with known true values and the real protocols.

It uses none of the equations of the estimators, only the same names of parameters, steps of plans and array types.
"""

from calstation.bench.client import BenchClock, BenchHost
from calstation.bench.config import BenchConfig, BenchReport, Order, OrderName
