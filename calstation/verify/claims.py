"""What a certificate or a result states, as a table: the kind and the subject of a statement, and its value.

Kinds are digest (of log, configuration), serial, verdict, value and sigma (of a parameter), correlation (of two), and
the decisions within, sigma_below and decision (both, for a certificate). Verdict and decisions are True for a pass.
"""

import json
import math
import re
import zlib
from types import SimpleNamespace
from xml.etree import ElementTree

from .model import NAMES
from .samples import UnreadableError

#: Exceptions of a damaged file.
DAMAGED: tuple[type[Exception], ...] = (OSError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError)
DAMAGED = (*DAMAGED, StopIteration, RecursionError, zlib.error, ElementTree.ParseError)
#: Largest file and largest attachment, bytes.
_LARGEST = 200_000_000


def read_claims(path):
    """Return the claims of a PDF (its attachments), a DCC or a result JSON. Raises UnreadableError."""
    try:
        if path.stat().st_size > _LARGEST:
            raise UnreadableError(f"{path} is larger than {_LARGEST} bytes")
        data, claims = path.read_bytes(), []
        for part in _attachments(data) if data.startswith(b"%PDF") else [data]:
            if part.lstrip().startswith(b"{"):
                claims.append(result_claim(json.loads(part), f"{path.name} (JSON)"))
            else:
                claims.append(SimpleNamespace(source=f"{path.name} (DCC)", result=None, table=_dcc(part.lstrip())))
    except DAMAGED as exc:
        raise UnreadableError(f"{path} cannot be read: {exc}") from exc
    if not claims:
        raise UnreadableError(f"{path} has no attached digital certificate")
    return claims


def _attachments(data):
    """Yield the embedded files of a PDF."""
    for match in re.finditer(rb"/EmbeddedFile\b(.{0,400}?)stream\r?\n", data, re.DOTALL):
        packed = data[match.end() :]
        if b"FlateDecode" in match[1]:
            yield zlib.decompressobj().decompress(packed, _LARGEST)
        elif b"endobj" not in match[1]:
            yield packed[: packed.index(b"endstream")].rstrip(b"\r\n")


def result_claim(result, source):
    """Return what a result JSON states."""
    digests = {"log": result["log"].get("sha256"), "configuration": result.get("configuration_sha256")}
    table = {("digest", key): digest for key, digest in digests.items() if digest}
    table["serial", "unit"] = result["unit"]["serial"]
    for name in (name for name in result["parameters"] if name in NAMES):
        row = result["parameters"][name]
        table["value", name], table["sigma", name] = float(row["value"]), float(row["sigma"])
    for one, row in result.get("correlation", {}).items():
        table |= {("correlation", f"{one}, {other}"): float(value) for other, value in row.items()}
    for check in result.get("checks", []):
        if check.get("kind") in ("within", "sigma_below"):
            table[check["kind"], check["subject"]] = bool(check["passed"])
    if result.get("passed") is not None:
        table["verdict", "unit"] = bool(result["passed"])
    return SimpleNamespace(source=source, result=result, table=table)


def _words(element, tag):
    """Return the words of the first descendant with a tag, or None if there is none."""
    found = element.find(f".//{{*}}{tag}")
    return None if found is None else found.text.split()


def _dcc(data):
    """Return what a digital calibration certificate states."""
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise ValueError("the certificate defines entities")
    root = ElementTree.fromstring(data)
    if not root.tag.endswith("}digitalCalibrationCertificate"):
        raise ValueError("it is no digital calibration certificate")
    table = {("serial", "unit"): " ".join(_words(root.find(".//{*}items"), "value"))}
    identifications = [(e.text or "").strip() for e in root.iterfind(".//{*}coreData//{*}value")]
    for digest in [text for text in identifications if re.fullmatch("[0-9a-f]{64}", text)][:1]:
        table["digest", "log"] = digest
    for conformity in root.iterfind(".//{*}statement[@refType='basic_conformity']//{*}conformity"):
        table["verdict", "unit"] = conformity.text.strip() == "pass"
    for quantity in root.iterfind(".//{*}quantity[@refType='basic_measuredValue']"):
        values = quantity.find("{*}realListXMLList")
        names, factor = _words(values, "labelXMLList"), _words(values, "coverageFactorXMLList")
        widths = _words(values, "uncertaintyXMLList")
        sigmas = [float(width) / float(factor[0]) for width in widths] if widths else [math.nan]
        columns = {"value": [float(word) for word in _words(values, "valueXMLList")], "sigma": sigmas}
        if decided := _words(quantity, "conformityXMLList"):
            columns["decision"] = [word == "pass" for word in decided]
        for kind, column in columns.items():  # one entry stands for equal ones
            rows = zip(names, column * len(names) if len(column) == 1 else column, strict=True)
            table |= {(kind, name): value for name, value in rows if name in NAMES}
    for joint in root.iterfind(".//{*}realList"):
        reals, columns = joint.findall("{*}real"), joint.findall(".//{*}column")
        if len(reals) == len(columns):
            matrix = [[float(e.text) for e in column.iterfind(".//{*}value")] for column in columns]
            _joint(table, [(_words(real, "label")[0], float(_words(real, "value")[0])) for real in reals], matrix)
    return table


def _joint(table, rows, matrix):
    """Add the correlations of a joint estimate. Raises ValueError if it differs from the table."""
    for k, (name, value) in enumerate(rows):
        stated = {("value", name): value, ("sigma", name): math.sqrt(matrix[k][k])}
        if not all(_same(number, table.get(key, number)) for key, number in stated.items()):
            raise ValueError(f"{name} differs between the list and the joint estimate")
        for j, (other, _) in enumerate(rows[:k]):
            scale = math.sqrt(matrix[k][k] * matrix[j][j])
            table["correlation", f"{name}, {other}"] = matrix[k][j] / scale if scale else 0.0


def _same(one, other):
    return math.isclose(one, other, rel_tol=1e-6) if {type(one), type(other)} == {float} else one == other


def contradictions(claims):
    """Yield (kind, subject, text) where two documents of one certificate differ."""
    first = claims[0]
    for other in claims[1:]:
        for kind, name in sorted(first.table.keys() | other.table.keys()):
            one, two = (claim.table.get((kind, name)) for claim in (first, other))
            is_stated = kind in ("serial", "verdict") and None in (one, two)  # a partial certificate states no verdict
            if (
                kind in ("serial", "verdict", "value", "sigma")
                and not is_stated
                and (one is None or not _same(one, two))
            ):
                yield "contradiction", name, f"{first.source} states a {kind} of {one}, {other.source} {two}"
