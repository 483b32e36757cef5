"""The outcome of a stored run is named alike everywhere, also that it is simulated."""

import pytest

from calstation.messages import Language, sentence
from calstation.results import Result, run_outcome
from calstation.results.result import SCHEMA

CASES = [
    ({"outcome": "passed"}, "PASS", "PASS", "合格"),
    ({"outcome": "passed", "simulated": True}, "PASS, simulated", "PASS, simulated", "合格，模拟"),
    ({"outcome": "passed", "partial": True}, "PARTIAL", "PARTIAL: Rate", "部分"),
    ({"outcome": "failed", "partial": True}, "FAIL (partial)", "FAIL (partial: Rate)", "不合格（部分）"),
    (
        {"outcome": "failed", "partial": True, "simulated": True},
        *("FAIL (partial), simulated", "FAIL (partial: Rate), simulated", "不合格（部分），模拟"),
    ),
    ({"outcome": "stopped", "simulated": True}, "STOPPED, simulated", "STOPPED, simulated", "已停止，模拟"),
]


@pytest.mark.parametrize(("content", "plain", "with_stages", "chinese"), CASES)
def test_outcome_of_a_stored_run(content: dict[str, object], plain: str, with_stages: str, chinese: str) -> None:
    base = {"schema": SCHEMA, "unit": {"serial": "SN-1"}, "stages": ["rate"], "parameters": {}, "log": {"file": "a.h5"}}
    result = Result.from_json({**base, **content})

    def said(*, stages: bool = False, language: Language = "en") -> str:
        return sentence(run_outcome(result, stages=stages), language)

    assert (said(), said(stages=True), said(language="zh_CN")) == (plain, with_stages, chinese)
