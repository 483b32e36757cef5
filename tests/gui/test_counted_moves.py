"""A designed stage counts moves, other stages count rounds."""

import pytest

from calstation.config import schedule_fields
from calstation.gui.engineer.schedule_form import _description
from calstation.gui.state import AppContext
from calstation.gui.text import event_line, schedule_text
from calstation.messages import Language
from calstation.reports.schedule import schedule_words
from calstation.sequencer import StageEnded


@pytest.mark.parametrize(
    ("code", "field", "ended"),
    [("en", "Moves", "after 12 moves"), ("zh_CN", "转动次数", "12 次转动后结束")],
)
def test_a_designed_stage_counts_moves_everywhere(app: AppContext, code: Language, field: str, ended: str) -> None:
    app.set_language(code)
    assert schedule_text("rounds", "designed") == field
    assert schedule_text("rounds", "excitation") == {"en": "Rounds", "zh_CN": "轮数"}[code]
    assert ended in event_line(StageEnded("designed", "rounds", 12))[1]
    assert list(schedule_words("designed", {"rounds": 22}, code)) == [f"{field} 22"]
    app.set_language("en")


@pytest.mark.parametrize(("code", "moves", "rounds"), [("en", "move", "round"), ("zh_CN", "次", "轮")])
def test_tooltips_of_a_designed_stage_speak_of_moves(app: AppContext, code: Language, moves: str, rounds: str) -> None:
    app.set_language(code)
    for spec in schedule_fields("designed"):
        assert rounds not in _description("designed", spec)
        if spec.name in ("rounds", "duration_s", "targets"):
            assert moves in _description("designed", spec)
            assert rounds in _description("excitation", spec)
    app.set_language("en")
