"""`test`: tests the link to the table, to the chamber or to the IMUs; nothing moves."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any

import typer

from calstation.cli.errors import command_options
from calstation.cli.options import JsonOption, ProductOption, StationOption, check_choice, command_group
from calstation.cli.show import emit, plain_console
from calstation.cli.text import LANGUAGE, say
from calstation.config import load_station
from calstation.connection import (
    LinkTestRequest,
    check_chamber_link,
    check_imu_link,
    check_table_link,
    incompatibilities,
    link_test_configuration,
)
from calstation.errors import DeviceFaultError
from calstation.messages import Report, render

_TESTS = {"table": check_table_link, "imu": check_imu_link, "chamber": check_chamber_link}

app = command_group()


@app.command()
def link(
    device: Annotated[str, typer.Argument(metavar="DEVICE")],
    station: StationOption = None,
    product: ProductOption = None,
    json: JsonOption = None,
) -> int:
    """Test the link to the table or chamber, or the links to the IMUs in all slots, and show every finding.

    Returns the exit code of a device fault after a warning or an error.
    """
    check_choice("DEVICE", device, tuple(_TESTS))
    console = plain_console(stderr=True)
    last = ""

    def progress(fraction: float, remaining_s: float | None = None, note: str = "") -> None:
        nonlocal last
        if note and note != last:
            last = note
            console.print(say(f"note.{note}"), style="dim")

    configured = load_station(station)[1]
    slots = configured.slot_names if device == "imu" else ()
    rows: list[dict[str, Any]] = []
    lines: list[str] = []
    for slot in slots or (None,):
        request = LinkTestRequest(configured, product, slot)
        report = _TESTS[device](progress, request)
        if device == "table" and product is not None and report.state != "error":
            more = incompatibilities(link_test_configuration(request))
            report = replace(report, findings=(*report.findings, *more))
        findings, finding_lines = _findings(report, command_options(station, product))
        row = {"device": report.device, "state": report.state, "findings": findings}
        rows.append(row if slot is None else {"slot": slot, **row})
        lines += ([] if slot is None else [f"[{slot}]"]) + finding_lines
    worst = next((row["state"] for row in rows if row["state"] != "ok"), "ok")
    emit({"device": device, "state": worst, "slots": rows} if slots else rows[0], json, lines)
    return 0 if worst == "ok" else DeviceFaultError.exit_code


def _findings(report: Report, options: Mapping[str, str]) -> tuple[list[dict[str, Any]], list[str]]:
    """Return the findings of a link test as JSON and as lines of text."""
    findings, lines = [], []
    for finding in report.findings:
        text = render(finding.message.code, {**finding.message.values, **options}, LANGUAGE)
        findings.append({**finding.to_json(), "text": text.text, "remedy": text.remedy})
        lines.append(f"{say(f'cli.finding_{finding.state}'):<7} {text.text}")
        lines += [f"        {text.remedy}"] if text.remedy else []
    return findings, [*lines, say(f"cli.link_{report.state}")]
