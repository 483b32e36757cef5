"""What is wrong with a log or a range, in the language in force and without the command line's options.

As with a run's faults, each English sentence of the solver is known by its pattern; one that is not is shown as it is.
"""

import re
from functools import cache
from pathlib import Path

from PySide6.QtCore import QCoreApplication

from calstation.errors import CalstationError
from calstation.gui.logs.recording_wording import RECORDINGS, word_value
from calstation.gui.text import language
from calstation.gui.text.messages import error_text, term
from calstation.messages.marked import QT_TRANSLATE_NOOP

_SAME: tuple[str, ...] = (
    QT_TRANSLATE_NOOP("logs", "the log holds no samples; record some"),
    QT_TRANSLATE_NOOP(
        "logs",
        "samples or configuration differ from what the run recorded (sha256); use an unchanged copy of the log",
    ),
    QT_TRANSLATE_NOOP("logs", "not a log; give a raw log (.h5) or a .csv(.gz) beside its .toml"),
    QT_TRANSLATE_NOOP("logs", "no such file; give the path of an existing log"),
    QT_TRANSLATE_NOOP("logs", "damaged, cut short or no raw log; use a copy of the log"),
    QT_TRANSLATE_NOOP("logs", "not a raw log of this program; give a .h5 log or a .csv"),
    QT_TRANSLATE_NOOP("logs", "row {0} is damaged; use a copy of the log"),
    QT_TRANSLATE_NOOP("logs", "its configuration is damaged ({0}); use a copy of the log"),
    QT_TRANSLATE_NOOP("logs", "is empty; give a header row and samples"),
    QT_TRANSLATE_NOOP("logs", "column '{0}' is missing; add it to the header and rows"),
    QT_TRANSLATE_NOOP("logs", "column '{0}' is missing; is it '{1}'?"),
    QT_TRANSLATE_NOOP("logs", "column '{0}' is there twice; remove one"),
    QT_TRANSLATE_NOOP("logs", "line {0} has {1} cells, the header {2}; complete the row or remove it"),
    QT_TRANSLATE_NOOP("logs", "line {0}: {1} is empty; correct the cell or remove the row"),
    QT_TRANSLATE_NOOP("logs", "line {0}: {1} is NaN; correct the cell or remove the row"),
    QT_TRANSLATE_NOOP("logs", "line {0}: {1} is infinite; correct the cell or remove the row"),
    QT_TRANSLATE_NOOP("logs", "line {0}: {1} = '{2}' is not a number; correct the cell or remove the row"),
    QT_TRANSLATE_NOOP(
        "logs", "line {0}: {1} = {2} is not a whole number; correct the cell or remove the row"
    ),
    QT_TRANSLATE_NOOP("logs", "line {0}: the log's rows are repeated from here; remove them"),
    QT_TRANSLATE_NOOP(
        "logs", "line {0}: seq {1} is repeated; remove repeated rows and sort the rest as they were sampled"
    ),
    QT_TRANSLATE_NOOP(
        "logs",
        "line {0}: seq falls from {1} to {2}; remove repeated rows and sort the rest as they were sampled",
    ),
    QT_TRANSLATE_NOOP(
        "logs",
        "line {0}: time_s falls from {1} to {2} s; remove repeated rows and sort the rest as they were sampled",
    ),
    QT_TRANSLATE_NOOP("logs", "rows near line {0} do not fit the header; save it again"),
    QT_TRANSLATE_NOOP("logs", "time_s runs at {0} Hz but imu.sample_rate_hz = {1}; correct one of them"),
    QT_TRANSLATE_NOOP("logs", "the compressed file is damaged or cut short; copy it again"),
    QT_TRANSLATE_NOOP("logs", "not UTF-8 text; save it as UTF-8"),
    QT_TRANSLATE_NOOP("logs", "cannot be read ({0})"),
    QT_TRANSLATE_NOOP("logs", "cannot be written ({0}); choose another folder"),
    QT_TRANSLATE_NOOP("logs", "the log's picture cannot be written ({0}); make room on its disk"),
    QT_TRANSLATE_NOOP("logs", "no samples after the header; record some"),
    QT_TRANSLATE_NOOP("logs", "no such file; give the path of an existing TOML file"),
    QT_TRANSLATE_NOOP("logs", "an export's name ends in .csv or .csv.gz; rename the target"),
    QT_TRANSLATE_NOOP("logs", "is the log itself; choose another name"),
    QT_TRANSLATE_NOOP(
        "logs",
        "stage '{0}': the solution diverged ({1}); "
        "check site.azimuth_deg, the axes in [table] and the sigmas in [prior]",
    ),
    QT_TRANSLATE_NOOP(
        "logs",
        "stage '{0}': no rest of at least 1 s in {1} s of samples to align on; "
        "include the rest before the first turn",
    ),
    QT_TRANSLATE_NOOP(
        "logs",
        "stage '{0}': no rest of {1} s or more with {2} upward ({3} rests found); include all six faces",
    ),
    QT_TRANSLATE_NOOP(
        "logs",
        "stage '{0}': no whole turn about {1} between two rests ({2} turns found); "
        "include both ways about every axis with the rests before and after",
    ),
    QT_TRANSLATE_NOOP(
        "logs",
        "stage '{0}': no whole turn about {1} between two rests ({2} turns found, "
        "{3} gaps or spoilt stretches, each of which costs its turn); "
        "include both ways about every axis with the rests before and after",
    ),
)

#: What the command line says, and what is said where there are boxes to fill in.
_INSTEAD: tuple[tuple[str, str], ...] = (
    (
        "no sample from {0} to {1}; the log holds {2} to {3}, choose --from and --to in there",
        QT_TRANSLATE_NOOP(
            "logs", "no sample from {0} to {1}; the log holds {2} to {3}, choose the range in there"
        ),
    ),
    (
        "no sample in the chosen range belongs to a stage; widen --from and --to, "
        "or name stages in the column 'stage'",
        QT_TRANSLATE_NOOP(
            "logs",
            "no sample in the chosen range belongs to a stage; widen the range, "
            "or name stages in the column 'stage'",
        ),
    ),
    (
        "no samples of stage '{0}' in the chosen range, which holds {1}; "
        "choose other --stages or widen --from and --to",
        QT_TRANSLATE_NOOP(
            "logs",
            "no samples of stage '{0}' in the chosen range, which holds {1}; "
            "choose other stages or widen the range",
        ),
    ),
    (
        "stage '{0}' was recorded twice; choose one with --stages, --from and --to",
        QT_TRANSLATE_NOOP(
            "logs", "stage '{0}' was recorded twice; choose a range that holds it once, or leave it out"
        ),
    ),
)

#: May stand before what is wrong with a recording.
_STAGE = "(?:stage '[a-z_]+': )?"


def word_log_error(error: CalstationError | str, path: Path | None = None) -> str:
    """An error of a log or a solution as a sentence; the log's own path is left off, the page shows it."""
    if isinstance(error, CalstationError) and error.code:
        return error_text(error).sentences
    said = str(error).removeprefix(f"{path}: ")
    head = ""
    for pattern, sentence in _patterns():
        found = pattern.fullmatch(said)
        if found is not None:
            head = found.group("file")
            values = [_stage_or_text(value) for value in found.groups()[1:]]
            said = head + QCoreApplication.translate("logs", sentence).format(*values)
            break
    if not head and said:
        said = said[0].upper() + said[1:]
    if said.endswith((".", "。", "?", "？")):
        return said
    return said + ("。" if language.current() == "zh_CN" else ".")


def _stage_or_text(value: str) -> str:
    """A stage's name or a phrase in words; anything else as it is."""
    word = term("stage", value)
    return word_value(value) if word == value.replace("_", " ") else word


@cache
def _patterns() -> tuple[tuple[re.Pattern[str], str], ...]:
    """A file other than the log may stand before the sentence."""
    made = []
    texts = [*((text, text, "") for text in _SAME), *((told, said, "") for told, said in _INSTEAD)]
    texts += [(text, text, _STAGE) for text in RECORDINGS]
    for told, said, before in texts:
        parts = (re.escape(part) for part in re.split(r"\{\d\}", told))
        pattern = r"(?P<file>(?:\S*[\\/.]\S*: )?)" + before + "(.*?)".join(parts)
        made.append((re.compile(pattern, re.DOTALL), said))
    return tuple(made)
