"""Compile every kernel once for `make test`, so that test workers do not compile concurrently."""

import subprocess
import sys

ESTIMATION = "from calstation.estimation.navigation.stage import warm_up; warm_up()"
BENCH = """
from calstation.bench.config import BenchConfig
from calstation.bench.process import warm_up
warm_up(BenchConfig())
warm_up(BenchConfig(table_protocol="gimbal"))
"""


if __name__ == "__main__":
    working = [subprocess.Popen([sys.executable, "-c", code]) for code in (ESTIMATION, BENCH)]
    sys.exit(max(process.wait() for process in working))
