"""What a certificate, a result or a log states: values, uncertainties, correlations, verdict and digests."""

import json
import math
import re
import zlib
from dataclasses import dataclass, field
from xml.etree import ElementTree

from .model import NAMES
from .samples import UnreadableError

#: Exceptions of a damaged file.
DAMAGED = (
    *(OSError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError, StopIteration, RecursionError),
    *(zlib.error, ElementTree.ParseError),
)
#: Largest file and largest attachment, bytes.
_LARGEST = 200_000_000


@dataclass
class Claim:
    """Statements of one document."""

    source: str
    serial: str | None = None
    digests: dict = field(default_factory=dict)  # of the log and of its configuration
    verdict: str | None = None  # pass, fail, or None without a statement
    values: dict = field(default_factory=dict)  # name -> (value, sigma)
    correlation: dict = field(default_factory=dict)  # (name, name) -> coefficient
    decisions: dict = field(default_factory=dict)  # (name, within | sigma_below | "") -> passed
    result: dict | None = None  # the result JSON


def read_claims(path):
    """Return the claims of a PDF (its attachments), a DCC or a result JSON. Raises UnreadableError."""
    try:
        if path.stat().st_size > _LARGEST:
            raise UnreadableError(f"{path} is larger than {_LARGEST} bytes")
        data = path.read_bytes()
        parts = _attachments(data) if data.startswith(b"%PDF") else [data]
        claims = [_claim(part.lstrip(), path.name) for part in parts]
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


def _claim(data, source):
    if data.startswith(b"{"):
        return result_claim(json.loads(data), f"{source} (JSON)")
    return _dcc(data, f"{source} (DCC)")


def result_claim(result, source):
    """Return what a result JSON states."""
    claim = Claim(source, result["unit"]["serial"], result=result)
    claim.digests = {"log": result["log"].get("sha256", ""), "configuration": result.get("configuration_sha256", "")}
    rows = result["parameters"].items()
    claim.values = {name: (row["value"], row["sigma"]) for name, row in rows if name in NAMES}
    for one, row in result.get("correlation", {}).items():
        claim.correlation.update({(one, other): value for other, value in row.items()})
    checks = [check for check in result.get("checks", []) if check.get("kind") in ("within", "sigma_below")]
    claim.decisions = {(check["subject"], check["kind"]): bool(check["passed"]) for check in checks}
    claim.verdict = {True: "pass", False: "fail"}.get(result.get("passed"))
    return claim


def _local(element):
    return element.tag.rpartition("}")[2]


def _all(element, name, kind=None):
    """Return the descendants of an element with a name and, if it is given, a `refType`."""
    return [e for e in element.iter() if _local(e) == name and kind in (None, e.get("refType"))]


def _texts(element, name):
    return [(e.text or "").split() for e in _all(element, name)]


def _dcc(data, source):
    """Return what a digital calibration certificate states."""
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise ValueError("the certificate defines entities")
    root = ElementTree.fromstring(data)
    if _local(root) != "digitalCalibrationCertificate":
        raise ValueError("it is no digital calibration certificate")
    claim = Claim(source)
    for core in _all(root, "coreData"):
        digests = [w[0] for w in _texts(core, "value") if w and re.fullmatch("[0-9a-f]{64}", w[0])]
        claim.digests["log"] = digests[0] if digests else ""
    claim.serial = " ".join(_texts(_all(root, "items")[0], "value")[0])
    for statement in _all(root, "statement", "basic_conformity"):
        claim.verdict = next((words[0] for words in _texts(statement, "conformity") if words), None)
    for quantity in _all(root, "quantity", "basic_measuredValue"):
        values = next(e for e in quantity if _local(e) == "realListXMLList")
        names, numbers = (_texts(values, tag)[0] for tag in ("labelXMLList", "valueXMLList"))
        factors, widths = (_texts(values, tag) for tag in ("coverageFactorXMLList", "uncertaintyXMLList"))
        sigmas = [float(w) / float(factors[0][0]) for w in widths[0]] if widths else [math.nan] * len(names)
        numbers, sigmas = (row * len(names) if len(row) == 1 else row for row in (numbers, sigmas))
        rows = zip(names, map(float, numbers), sigmas, strict=True)
        claim.values.update({name: (value, sigma) for name, value, sigma in rows if name in NAMES})
        for decided in _texts(quantity, "conformityXMLList")[:1]:
            claim.decisions.update({(n, ""): word == "pass" for n, word in zip(names, decided, strict=True)})
    for joint in _all(root, "realList"):
        names, columns = [words[0] for words in _texts(joint, "label")], _all(joint, "column")
        if len(names) != len(columns):
            continue
        matrix = [[float(v[0]) for v in _texts(column, "value")] for column in columns]
        stated = [float(v[0]) for e in joint if _local(e) == "real" for v in _texts(e, "value")[:1]]
        for k, (name, value) in enumerate(zip(names, stated, strict=True)):
            if name in claim.values and not _same((value, math.sqrt(matrix[k][k])), claim.values[name]):
                raise ValueError(f"{name} differs between the list and the joint estimate")
            for j, other in enumerate(names[:k]):
                scale = math.sqrt(matrix[k][k] * matrix[j][j])
                claim.correlation[name, other] = matrix[k][j] / scale if scale else 0.0
    return claim


def _same(one, other):
    return all(math.isclose(a, b, rel_tol=1e-6, abs_tol=1e-30) for a, b in zip(one, other, strict=True))


def contradictions(claims):
    """Yield (subject, text) where two documents of one certificate differ."""
    first = claims[0]
    for other in claims[1:]:
        for key in ("serial", "verdict"):  # a partial certificate states no verdict
            one, two = getattr(first, key), getattr(other, key)
            if len({one, two} - {None}) > 1:
                yield key, f"{first.source} states {one}, {other.source} {two}"
        for name in sorted(first.values.keys() | other.values.keys()):
            one, two = first.values.get(name), other.values.get(name)
            if one is None or two is None or not _same(one, two):
                yield name, f"{first.source} states {one}, {other.source} {two}"
