"""One Chinese word for one thing in the texts of the catalogue."""

import re

import pytest

from tests.messages.test_codes import all_entries

#: Chinese that is not used, and the English beside which it is not used.
WRONG = [
    ("本机不?输出|采集本机", ""),  # 本机 is this computer, and 产品 the unit
    ("^重做这一步", ""),  # an instruction, where an event in the past is described
    ("寄存器.*(核对|校验)|读核对|效果未能核对", "[Vv]erified"),
    ("限值", r"limits? (of the product|from)|sigmas?.* limit"),
    ("密码", r"\bPINs?\b"),
    ("[\u4e00-\u9fff] ?PIN(?! 码)", ""),
]


@pytest.mark.parametrize(("wrong", "english"), WRONG)
def test_one_word_is_used_for_one_thing(wrong: str, english: str) -> None:
    texts = [(e.code, e.text + e.remedy + e.window, e.zh + e.zh_remedy) for e in all_entries()]
    assert texts
    assert not [code for code, text, zh in texts if re.search(english, text) and re.search(wrong, zh)]
