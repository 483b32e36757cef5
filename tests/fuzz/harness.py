"""Coverage-guided fuzzing: `python tests/fuzz/harness.py [-max_total_time=SECONDS] [CORPUS]` (libFuzzer's options).

The first byte of an input selects the target; the rest is passed to it. Needs the extra `fuzz` (atheris).
"""

import sys

import atheris

READERS = ["calstation.devices", "calstation.records", "calstation.config", "calstation.schema"]

with atheris.instrument_imports(include=[*READERS, "targets", "file_targets"]):
    from targets import TARGETS

CHOICE = list(TARGETS.values())


def one_input(data: bytes) -> None:
    """Pass one input to the target that it selects."""
    if data:
        CHOICE[data[0] % len(CHOICE)](data[1:])


if __name__ == "__main__":
    atheris.Setup(sys.argv, one_input)
    atheris.Fuzz()
