"""Translated texts of the window: catalogue sentences, check texts and language bindings; no widget classes."""

from calstation.gui.text import language
from calstation.gui.text.checks import check_name, check_text, of_parameter, of_product, parameter_text
from calstation.gui.text.messages import (
    KINDS,
    Words,
    bind,
    duration_text,
    fault_text,
    on_language_change,
    rendered,
    say,
    step_sentence,
    term,
    with_minus,
    without_minus,
)
from calstation.gui.text.products import offered_products, product_text
