"""A designed stage counts moves, other stages count rounds."""

import pytest

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
