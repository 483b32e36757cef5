"""The header of a result on the engineer page names an offline solution and its range of samples."""

import pytest

from calstation.gui.engineer.result_analysis import ResultAnalysis
from calstation.gui.state import AppContext
from calstation.gui.text import say
from calstation.results import FinishedRun
from tests.gui.conftest import result_with


@pytest.mark.parametrize(
    ("code", "words"), [("en", "solved offline from samples 2500 to 9000"), ("zh_CN", "离线解算，采样点 2500 到 9000")]
)
def test_header_of_a_solution_of_a_part_of_a_log_names_the_range(app: AppContext, code: str, words: str) -> None:
    analysis = ResultAnalysis(app)
    app.set_language(code)
    for log, shown in (({"part": True, "first_seq": 2500, "last_seq": 9000}, True), ({}, False)):
        analysis._run = FinishedRun(result_with(outcome="resolved", log={"file": "x.h5", **log}), None, {})
        assert (words in analysis.source()) is shown
    analysis._run = FinishedRun(result_with(), None, {})
    assert say("common.solved_offline") not in analysis.source()
    app.set_language("en")
