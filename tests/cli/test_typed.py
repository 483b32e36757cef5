"""Commands in sentences can be typed as they are printed."""

import shlex
from pathlib import Path

import numpy as np
import pytest

from calstation.cli.run import complain
from calstation.cli.usage import as_typed, said_as_typed
from calstation.config.request import OR_AT_REST, RunRequest
from calstation.devices.interfaces import TableStatus
from calstation.errors import DeviceFaultError
from calstation.physics.table import JointLimits
from calstation.sequencer.events import Fault
from calstation.sequencer.guard import check_power

HERE = RunRequest("SN-1", Path("line 3.toml"), Path("unit.toml"), out=Path("today"))


def latched(fault: str) -> TableStatus:
    """A table that stands still, with a fault."""
    still = np.zeros(2)
    return TableStatus(
        angles=still,
        rates=still,
        enabled=False,
        homed=True,
        moving=False,
        settled=True,
        fault=fault,
        interlock_closed=True,
        watchdog=1.0,
        limits=JointLimits(),
    )


def test_the_reset_of_a_latched_fault_is_of_the_station_that_told_it(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(DeviceFaultError) as told:
        check_power(latched("watchdog"))
    fault = Fault("DeviceFaultError", f"{told.value}{OR_AT_REST}", 3)
    assert complain(fault, HERE, debug=False) == 3
    said = capsys.readouterr().err
    assert "or calstation table reset --station 'line 3.toml' --product unit.toml; or leave" in said
    assert complain(fault, RunRequest("SN-1"), debug=False) == 3
    assert "or calstation table reset; or leave" in capsys.readouterr().err


def test_an_engine_that_died_names_its_station_as_well() -> None:
    with (
        pytest.raises(
            DeviceFaultError, match=r"calstation table reset --station 'line 3\.toml' --product unit\.toml\)"
        ),
        said_as_typed(HERE),
    ):
        raise DeviceFaultError("run.engine_silent")


@pytest.mark.parametrize(
    "text",
    [
        "it holds neither; finish or restore it: calstation registers finish SN-1, or restore SN-1",
        "the unit holds neither: calstation registers finish (or restore) SN-1",
    ],
)
def test_an_interrupted_transfer_is_settled_where_it_was_met(text: str) -> None:
    said = as_typed(text, HERE)
    assert "SN-1 --station 'line 3.toml' --product unit.toml --out today" in said
    assert as_typed(text, RunRequest("SN-1")) == text
    command = said.partition(": calstation ")[2].replace("(or restore) ", "").split(", or ")[0]
    unit = ["registers", "finish", "SN-1"]
    where = ["--station", "line 3.toml", "--product", "unit.toml", "--out", "today"]
    assert shlex.split(command) == unit + where
