"""Texts of the window in the current language, and their binding to widgets."""

from calstation.gui.text import language
from calstation.gui.text.checks import (
    check_name,
    check_names,
    check_text,
    checks_tip,
    is_parameter_check,
    is_product_check,
    limit_ratio,
    limit_text,
    parameter_text,
)
from calstation.gui.text.events import event_line
from calstation.gui.text.messages import (
    KINDS,
    Words,
    about,
    bind,
    duration_text,
    engineer_corrects,
    fault_text,
    for_operator,
    offered_products,
    on_language_change,
    product_text,
    rendered,
    say,
    schedule_text,
    sigmas_text,
    station_text,
    step_sentence,
    term,
    with_minus,
    without_minus,
)
