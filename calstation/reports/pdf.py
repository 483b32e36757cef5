"""Typesetting of a certificate as PDF/A-3b with the templates in `data/reports`, which a site may copy and change."""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, time
from pathlib import Path
from typing import Any

from calstation.config import library
from calstation.errors import InputError
from calstation.messages import Language, os_reason
from calstation.reports.analysis import Analysis
from calstation.reports.content import Certificate
from calstation.reports.document import document

#: Folder of the templates among shipped files and in the site's own folder.
FOLDER = "reports"
#: Template of the document.
_MAIN = "certificate.typ"
#: Chinese fonts in the order of preference.
CHINESE_FONTS = (
    "Noto Serif CJK SC",
    "Source Han Serif SC",
    "SimSun",
    "Songti SC",
    "Noto Sans CJK SC",
    "Source Han Sans SC",
    "Microsoft YaHei",
    "PingFang SC",
    "WenQuanYi Micro Hei",
    "WenQuanYi Zen Hei",
    "Droid Sans Fallback",
)
_CHINESE = re.compile(r"[\u2e80-\u9fff\uff00-\uffef]")


@dataclass(frozen=True)
class Attachment:
    """A file embedded in the PDF."""

    name: str
    mime_type: str
    content: bytes
    #: ``source`` of the document, or an ``alternative`` representation of it.
    relationship: str


def typeset(
    certificate: Certificate,
    analysis: Analysis,
    language: Language,
    attachments: Sequence[Attachment],
    folder: Path | None = None,
) -> bytes:
    """Return the PDF of a certificate; identical input and fonts yield identical bytes.

    Templates in `folder` take precedence over the site's and the shipped templates. Raises InputError.
    """
    import typst

    data = json.dumps(document(certificate, analysis, language), ensure_ascii=False, sort_keys=True)
    files = used_templates(folder)
    chinese = _chinese_font(language, data)
    inputs = {
        "data": data,
        "chinese": chinese,
        "attachments": json.dumps(
            [
                {
                    "name": a.name,
                    "mime_type": a.mime_type,
                    "relationship": a.relationship,
                    "content": a.content.decode(),
                }
                for a in attachments
            ],
            ensure_ascii=False,
        ),
    }
    issued = datetime.combine(certificate.issued, time(), UTC)
    main: Any = {"main.typ": files.pop(_MAIN), **files}
    try:
        pdf = typst.compile(
            main, sys_inputs=inputs, pdf_standards=["a-3b"], timestamp=int(issued.timestamp()), format="pdf"
        )
    except typst.TypstError as exc:
        where = folder or library.site_folder() / FOLDER
        raise InputError("report.template", folder=where, detail=exc.message) from exc
    assert isinstance(pdf, bytes)
    return pdf


def used_templates(folder: Path | None) -> dict[str, bytes]:
    """Return the files that the document uses, by name: the main template, and files whose names occur in used files.

    Raises InputError.
    """
    files = _templates(folder)
    used: dict[str, bytes] = {}
    waiting = [_MAIN]
    while waiting:
        name = waiting.pop()
        used[name] = files[name]
        waiting += [other for other in files if other not in (*used, *waiting) and other.encode() in used[name]]
    return used


def _templates(folder: Path | None) -> dict[str, bytes]:
    """Return the files in the folders of templates by name. Raises InputError."""
    files: dict[str, bytes] = {}
    for place in (library.shipped_folder() / FOLDER, library.site_folder() / FOLDER, folder):
        if place is None or (place != folder and not place.is_dir()):
            continue
        try:
            files |= {path.name: path.read_bytes() for path in sorted(place.iterdir()) if path.is_file()}
        except OSError as exc:
            raise InputError("report.templates_unreadable", folder=place, reason=os_reason(exc)) from exc
    return files


def _chinese_font(language: Language, text: str) -> str:
    """Return the font for Chinese text; "" if the document has none. Raises InputError without such a font."""
    import typst

    installed = set(typst.Fonts().families())
    found = next((font for font in CHINESE_FONTS if font in installed), "")
    if not found and (language == "zh_CN" or _CHINESE.search(text)):
        raise InputError("report.no_chinese_font", fonts=list(CHINESE_FONTS))
    return found
