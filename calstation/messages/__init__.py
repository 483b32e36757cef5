"""The message catalogue: all errors, events, findings and terms shown to users, in English and Chinese."""

from calstation.messages import rendering
from calstation.messages.catalogue import entry, known
from calstation.messages.finding import Finding, Report
from calstation.messages.rendering import (
    Language,
    Rendered,
    Text,
    Value,
    event_text,
    joined,
    local_time,
    os_reason,
    parameter_name,
    plain_number,
    product_name,
    render,
    rounds_text,
    schedule_name,
    sentence,
    short_step_text,
    station_name,
    step_text,
    term,
    values_from_json,
    values_to_json,
    with_minus,
)
