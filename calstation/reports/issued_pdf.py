"""PDFs of issued certificates, and their comparison with the digests in the audit trail of the site."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from calstation.config import site_folder
from calstation.messages import Language
from calstation.records import site_events


@dataclass(frozen=True)
class IssuedPdf:
    """The PDF of an issued certificate, and the SHA-256 of all files that were written for this certificate."""

    path: Path
    digests: frozenset[str]  #: Empty if the audit trail does not contain the issue, for example of another site.

    def intact(self) -> bool | None:
        """Return whether the file is one that was issued; None if it is unreadable or nothing was recorded."""
        try:
            digest = hashlib.sha256(self.path.read_bytes()).hexdigest()
        except OSError:
            return None
        return digest in self.digests if self.digests else None


def pdf_name(identification: str, language: Language) -> str:
    """Return the name of the PDF of a certificate in a language."""
    return f"{identification}{'_zh' if language == 'zh_CN' else ''}.pdf"


def find_pdfs(folder: Path, identifications: Sequence[str], languages: Sequence[Language]) -> list[IssuedPdf | None]:
    """Return a PDF in a folder for every certificate: a changed one, otherwise that in the first of the languages.

    Raises InputError if the audit trail cannot be read.
    """
    events = [each.values for each in site_events(site_folder())]
    pdfs = []
    for identification in identifications:
        issues = [values for values in events if values.get("certificate") == identification]
        digests = frozenset(str(digest) for values in issues for digest in file_digests(values))
        paths = (folder / pdf_name(identification, code) for code in languages)
        existing = [IssuedPdf(path, digests) for path in paths if path.is_file()]
        changed = next((pdf for pdf in existing if pdf.intact() is False), None)
        pdfs.append(changed or next(iter(existing), None))
    return pdfs


def file_digests(values: Mapping[str, object]) -> list[object]:
    """Return the SHA-256 of the files in an event of the audit trail."""
    files = values.get("files")
    return list(files.values()) if isinstance(files, dict) else []
