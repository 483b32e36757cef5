"""Exports the log as CSV and TOML, and the result as JSON or CSV, to files that the user chooses."""

from pathlib import Path

from calstation.gui.state import FileExport
from calstation.gui.text import say
from calstation.records import LOG_SUFFIXES
from calstation.results import Result, export_log, export_result
from calstation.results.plots import LogIndex


class Exports(FileExport):
    """Exports of a log and of its result."""

    def ask_log(self, log: LogIndex, first: int, last: int) -> None:
        """Ask for the file to which a log's samples from `first` to `last` are exported."""
        whole = (first, last) == (log.facts.first_seq, log.facts.last_seq)
        ending = "export" if whole else f"{first}-{last}"
        self.ask(
            say("logs.export_log" if whole else "logs.export_range"),
            log.path.with_name(f"{_stem(log.path)}-{ending}.csv"),
            ["CSV (*.csv)", say("logs.csv_compressed")],
            lambda target: (export_log, log.path, target, first, last),
        )

    def ask_result(self, log: Path, result: Result, stored: Result | None, ending: str = "offline") -> None:
        """Ask for the file of a log's result; `stored` is the run's result, `ending` a suffix of the proposed name."""
        self.ask(
            say("logs.export_result_title"),
            log.with_name(f"{_stem(log)}-{ending}.json"),
            ["JSON (*.json)", say("logs.csv_parameters")],
            lambda target: (export_result, result, stored, target),
        )


def _stem(path: Path) -> str:
    return next((path.name.removesuffix(end) for end in LOG_SUFFIXES if path.name.endswith(end)), path.name)
