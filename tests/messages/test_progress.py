"""The catalogue describes progress events and steps."""

from calstation.messages import event_text, sentence, short_step_text, step_text


def test_event_text_translates_its_values() -> None:
    text = event_text("step_repeated", {"reason": "gap", "attempt": 2})
    assert sentence(text) == "Step repeated (samples lost), attempt 2."
    assert sentence(text, "zh_CN") == "这一步已重做（丢数），第 2 次。"
    resumed = event_text("resumed", {"log": "a.h5", "stages": ["rate", "six_position"]})
    assert sentence(resumed) == "Resuming a.h5 after its completed stages: Rate, Six positions."


def test_an_unknown_event_is_shown_with_its_values() -> None:
    assert sentence(event_text("something_new", {"a": 1, "b": "x"})) == "something new: a 1, b x"
    assert sentence(event_text("something_new", {})) == "something new"


def test_step_text_follows_its_label() -> None:
    assert sentence(step_text("move", ("turn_about", "x", 90.0))) == "Turning about x by 90°"
    assert sentence(step_text("carry", ("carry", 90.0, 0.0, 10.0, 1.0, 8.0)), "zh_CN").startswith("外导轨转到 90°")
    assert sentence(step_text("dwell", ("position", 0.0, 90.0))) == "Resting"
    assert sentence(step_text("move", ())) == "Moving"
    assert sentence(step_text("move", ("third_turn", "x", 1.5))) == "third turn x 1.5"


def test_move_has_a_short_text_for_small_displays() -> None:
    assert sentence(short_step_text(("turn_about", "x", -90.0))) == "x -90°"
    assert sentence(short_step_text(("flip", 180.0)), "zh_CN") == "翻转 +180°"
    assert sentence(short_step_text(("carry", 90.0, 0.0, 10.0, 1.0, 8.0))) == "90°, 0°"
    assert sentence(short_step_text(("verify",))) == "Turn to verify the written registers"
