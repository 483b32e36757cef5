"""The PDF of a validation, in English or Chinese, with the signed JSON embedded."""

import json
from collections.abc import Mapping
from datetime import datetime
from typing import Any

from calstation.config import library
from calstation.errors import InputError
from calstation.messages import Language, Text, known, render, term, values_from_json
from calstation.reports import compile_template
from calstation.validation.lines import AREAS
from calstation.validation.report import Validation, signed_json

#: Languages of the documents, each with the end of its file name, as for certificates.
LANGUAGES: dict[Language, str] = {"en": "", "zh_CN": "_zh"}
_TEMPLATE = "validation.typ"
#: Texts of the document, in the family ``validation_label``.
_LABELS = (
    *("title", "number", "page", "of", "computer", "system", "user", "software", "python", "begun"),
    *("duration", "check", "expected", "found", "state", "clause", "changes", "before", "after", "summary"),
    *("area", "ok", "failed", "not_checked", "failures", "gaps", "authorised", "reviewed", "allowed"),
    *("refused", "signature", "signed", "unsigned", "trail", "key", "attached", "basis", "basis_text"),
    *("repeat", "end", "verdict_passed", "verdict_failed", "verdict_incomplete", "no_changes", "date"),
    "purpose",
)


def write_documents(validation: Validation) -> tuple[dict[str, bytes], Text | None]:
    """Return the files of a validation by name: JSON, and a PDF in each language; and why it is not signed, or None.

    Raises InputError if the template cannot be typeset.
    """
    data, unsigned = signed_json(validation)
    content = json.dumps(data, indent=1, ensure_ascii=False) + "\n"
    files = {f"{validation.name}.json": content.encode()}
    for language, ending in LANGUAGES.items():
        files[f"{validation.name}{ending}.pdf"] = _typeset(validation, data, content, unsigned, language)
    return files, unsigned


def content_text(content: Any, language: Language) -> str:
    """Return the content of a line in a language."""
    value = values_from_json({"": content})[""]
    return render(value.code, value.values, language).sentences if isinstance(value, Text) else str(value or "")


def line_name(line: Mapping[str, Any], language: Language) -> str:
    """Return the name of a check with its subject."""
    name = term("validation_check", line["check"], language)
    subject, code = line["subject"], f"validation_subject.{line['subject']}"
    if known(code):
        subject = term("validation_subject", subject, language)
    elif line["area"] in ("calculation", "time"):
        subject = term("stage", subject, language)
    return f"{name}{'：' if language == 'zh_CN' else ': '}{subject}" if subject else name


def line_texts(line: Mapping[str, Any], language: Language) -> dict[str, str]:
    """Return name, expectation and finding of a line, with the reason."""
    expected, found, reason = (content_text(line[name], language) for name in ("expected", "found", "reason"))
    return {"name": line_name(line, language), "expected": expected, "found": f"{found} {reason}".strip()}


def row_text(row: Mapping[str, Any], side: str, language: Language) -> str:
    """Return one side of a difference, ``"before"`` or ``"after"``."""
    value = row[side]
    if row["check"] == "verdict":
        return term("validation_label", f"verdict_{value}", language)
    if not isinstance(value, dict):
        return str(value or "–")
    state = term("validation_label", value["state"], language)
    return f"{content_text(value['found'] or value['reason'], language)} ({state})"


def _typeset(
    validation: Validation, data: Mapping[str, Any], content: str, unsigned: Text | None, language: Language
) -> bytes:
    from typst import TypstError

    lines = [{**each, **line_texts(each, language)} for each in data["lines"]]
    areas = [
        {
            "name": term("validation_area", area, language),
            "clause": clause,
            "lines": [each for each in lines if each["area"] == area],
        }
        for area, clause in AREAS.items()
    ]
    changes = [
        {"name": line_name(each, language), **{side: row_text(each, side, language) for side in ("before", "after")}}
        for each in data["changes"]
    ]
    document = {
        **{name: data[name] for name in ("name", "computer", "system", "software", "verdict", "earlier")},
        **{name: data[name] or "–" for name in ("user", "trail", "key", "signature")},
        "language": "zh" if language == "zh_CN" else "en",
        "labels": {name: term("validation_label", name, language) for name in _LABELS},
        "python": data["identity"]["python"],
        "begun": data["started_utc"][:19].replace("T", " ") + " UTC",
        "count": render("validation.counts", data["counts"], language).text,
        "duration": f"{data['duration_s']:.0f} s",
        "areas": areas,
        "changes": changes,
        "unsigned": "" if unsigned is None else render(unsigned.code, unsigned.values, language).sentences,
    }
    inputs = {"data": json.dumps(document, ensure_ascii=False), "attachment": content}
    path = library.shipped_folder() / "reports" / _TEMPLATE
    try:
        time = datetime.fromisoformat(validation.started_utc)
        return compile_template({"main.typ": path.read_bytes()}, inputs, time, library.fonts_folder())
    except (OSError, TypstError) as exc:
        raise InputError("report.template", folder=path.parent, detail=getattr(exc, "message", str(exc))) from exc
