"""Compile kernels and test modules once for `make test`, so that test workers do not all compile them."""

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
    commands = (["-c", ESTIMATION], ["-c", BENCH], ["-m", "pytest", "--collect-only", "--quiet", *sys.argv[1:]])
    working = [subprocess.Popen([sys.executable, *words], stdout=subprocess.DEVNULL) for words in commands]
    sys.exit(max(process.wait() for process in working))
