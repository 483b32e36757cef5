"""Messages of stages that say the same word for word appear once, online and offline."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from calstation.estimation import Method, Solution
from calstation.estimation.common import Consistency
from calstation.records import open_log
from calstation.results import solver_chain
from tests.cli.conftest import six_position_rows, write_log


def test_message_that_an_earlier_stage_has_shown_word_for_word_is_not_repeated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    chain = solver_chain.StageChain(open_log(write_log(tmp_path, six_position_rows())).meta)
    six_position: Method = solver_chain.method("six_position")
    stages = ("rate", "excitation", "azimuth_flip")

    def quiet(stage: str) -> Method:
        messages = (("table_quiet", {}), ("azimuth_from_data", {"stage": stage}))
        solution = Solution(stage, chain.prior, (), Consistency(0.0, 0.0, 0.0, 0), messages=messages)

        def solver(*arguments: object) -> object:
            real = six_position.solver(*arguments)  # type: ignore[arg-type]
            return SimpleNamespace(buffer=real.buffer, data=real.data, finish=lambda progress: solution)

        return replace(six_position, solver=solver)

    monkeypatch.setattr(solver_chain, "method", quiet)
    for stage in stages:
        chain.start(stage)
        chain.finish()
    said = [code for solution in chain.solutions for code, _ in solution.messages]
    assert said == ["table_quiet", "azimuth_from_data", "azimuth_from_data", "azimuth_from_data"]
