"""Texts appear in the terminal as they are, with their brackets."""

import io
from pathlib import Path

import calstation.cli
from calstation.cli.show import new_table, plain_console

REMEDY = "Set sample_rate_hz = 200 in [imu], or correct [columns] of /data/[bold]log.csv."


def test_brackets_are_printed() -> None:
    out = io.StringIO()
    table = new_table("", "cli.column_parameter")
    table.add_row("[prior]")
    for item in (REMEDY, table):
        plain_console(file=out, width=120).print(item)
    assert REMEDY in out.getvalue()
    assert "[prior]" in out.getvalue()


def test_every_command_prints_to_such_a_console() -> None:
    files = Path(calstation.cli.__file__).parent.rglob("*.py")
    own = {path.name for path in files if "= Console(" in (text := path.read_text("utf-8")) or "(Console(" in text}
    assert not own
