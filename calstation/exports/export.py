"""Writing of an export and of its check."""

import json
from pathlib import Path

from calstation.errors import ConfigurationError
from calstation.exports.check import ExportCheck, check_export
from calstation.exports.formats import FORMATS
from calstation.exports.source import ExportSource
from calstation.messages import Text, os_reason
from calstation.records import write_atomic

#: Ending of the file with the check.
CHECK_SUFFIX = ".check.json"


def export_calibration(source: ExportSource, to: str, path: Path, *, allow_loss: bool = False) -> ExportCheck:
    """Check a calibration in the format of another program, and write it and the result of the check next to it.

    Raises ConfigurationError if the format is unknown, if a value that it cannot express exceeds its limit and loss
    is not allowed, or if a file cannot be written.

    Parameters
    ----------
    source : calibration to export
    to : name of the format
    path : file to write
    allow_loss : whether parameters that the format cannot express may exceed the product's limits
    """
    if to not in FORMATS:
        raise ConfigurationError("cli.unknown_choice", option="--to", value=to, choices=tuple(FORMATS))
    files = FORMATS[to].write(source)
    check = check_export(to, FORMATS[to], files, source)
    if check.exceeding and not allow_loss:
        names = [Text.of("export.of_limit", name=name, share=check.of_limit[name]) for name in check.exceeding]
        raise ConfigurationError("export.loss", format=to, names=names)
    content = {**files, CHECK_SUFFIX: json.dumps(check.to_json(), indent=1).encode() + b"\n"}
    for ending, data in content.items():
        target = path.with_name(path.name + ending)
        try:
            write_atomic(target, data)
        except OSError as exc:
            raise ConfigurationError("result.unwritable", file=target, reason=os_reason(exc)) from exc
    return check
