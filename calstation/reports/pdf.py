"""Typesetting as PDF/A-3b with Typst templates; a site may copy and change the templates in `data/reports`."""

import json
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

#: Name of the folder of templates in the shipped files and in the site folder.
FOLDER = "reports"
#: Template of the document.
_MAIN = "certificate.typ"


@dataclass(frozen=True)
class Attachment:
    """A file embedded in the PDF."""

    name: str
    mime_type: str
    content: bytes
    #: ``source`` of the document, or ``alternative`` for another representation.
    relationship: str


def typeset(
    certificate: Certificate,
    analysis: Analysis,
    language: Language,
    attachments: Sequence[Attachment],
    folder: Path | None = None,
) -> bytes:
    """Return the PDF of a certificate, which is identical for identical input.

    Raises InputError.

    Parameters
    ----------
    certificate : content of the certificate
    analysis : analysis of the samples of its log
    language : language of the texts
    attachments : embedded files
    folder : templates that take precedence over the site's and the shipped templates
    """
    from typst import TypstError

    data = json.dumps(document(certificate, analysis, language), ensure_ascii=False, sort_keys=True)
    files = used_templates(folder)
    inputs = {
        "data": data,
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
    template_folder = folder or library.site_folder() / FOLDER
    try:
        return compile_template({"main.typ": files.pop(_MAIN), **files}, inputs, issued, template_folder)
    except TypstError as exc:
        raise InputError("report.template", folder=template_folder, detail=exc.message) from exc


def compile_template(main: Path | dict[str, bytes], inputs: dict[str, str], time: datetime, folder: Path) -> bytes:
    """Return the PDF of a Typst template in the shipped font and the fonts in `folder`; installed fonts are ignored.

    Parameters
    ----------
    main : the template, or the contents of its files by name, of which the first is the template
    inputs : texts in `sys.inputs`
    time : time stated in the PDF
    folder : folder that may contain fonts for characters missing in the shipped font

    Raises InputError if no font contains a character, and TypstError.
    """
    import typst

    fonts = [library.fonts_folder(), folder]
    options: dict[str, Any] = {"format": "pdf", "pdf_standards": ["a-3b"], "timestamp": int(time.timestamp())}
    options |= {"font_paths": [path for path in fonts if path.is_dir()], "ignore_system_fonts": True}

    def without_font(characters: str) -> list[str]:
        try:
            typst.compile(b"#sys.inputs.text", sys_inputs={"text": characters}, **options)
        except typst.TypstError:
            half = len(characters) // 2
            return without_font(characters[:half]) + without_font(characters[half:]) if half else [characters]
        return []

    try:
        pdf: bytes = typst.compile(main, sys_inputs=inputs, **options)
    except typst.TypstError:
        if characters := without_font("".join(sorted(set("".join(inputs.values()))))):
            raise InputError("report.no_font", characters=characters, folder=folder) from None
        raise
    return pdf


def used_templates(folder: Path | None) -> dict[str, bytes]:
    """Return the main template and, recursively, the files whose names occur in it, by name.

    Raises InputError.
    """
    files = _templates(folder)
    used: dict[str, bytes] = {}
    pending = [_MAIN]
    while pending:
        name = pending.pop()
        used[name] = files[name]
        pending += [other for other in files if other not in (*used, *pending) and other.encode() in used[name]]
    return used


def _templates(folder: Path | None) -> dict[str, bytes]:
    """Return the files in the folders of templates by name. Raises InputError."""
    files: dict[str, bytes] = {}
    for template_folder in (library.shipped_folder() / FOLDER, library.site_folder() / FOLDER, folder):
        if template_folder is None or (template_folder != folder and not template_folder.is_dir()):
            continue
        try:
            files |= {path.name: path.read_bytes() for path in sorted(template_folder.iterdir()) if path.is_file()}
        except OSError as exc:
            raise InputError("report.templates_unreadable", folder=template_folder, reason=os_reason(exc)) from exc
    return files
