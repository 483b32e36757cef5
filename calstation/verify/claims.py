"""What a certificate, a result or a log states: values, uncertainties, correlations, verdict and digests."""

import json
import math
import re
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

from .model import NAMES
from .samples import UnreadableError

#: Further exceptions of a damaged file.
_DAMAGED = (StopIteration, RecursionError, zlib.error, ElementTree.ParseError)
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
    path = Path(path)
    try:
        if path.stat().st_size > _LARGEST:
            raise UnreadableError(f"{path} is larger than {_LARGEST} bytes")
        data = path.read_bytes()
        parts = list(_attachments(data)) if data.startswith(b"%PDF") else [data]
        claims = [_claim(part, path.name) for part in parts]
    except (OSError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError, *_DAMAGED) as exc:
        raise UnreadableError(f"{path} cannot be read: {exc}") from exc
    if not claims:
        raise UnreadableError(f"{path} has no attached digital certificate")
    return claims


def _attachments(data):
    """Yield the embedded files of a PDF."""
    for match in re.finditer(rb"/EmbeddedFile\b(.{0,400}?)stream\r?\n", data, re.DOTALL):
        if b"endobj" in match[1]:
            continue
        packed = data[match.end() :]
        if b"FlateDecode" in match[1]:
            yield zlib.decompressobj().decompress(packed, _LARGEST)
        else:
            yield packed[: packed.index(b"endstream")].rstrip(b"\r\n")


def _claim(data, source):
    text = data.lstrip()
    return (
        result_claim(json.loads(text), f"{source} (JSON)") if text.startswith(b"{") else _dcc(text, f"{source} (DCC)")
    )


def result_claim(result, source):
    """Return what a result JSON states."""
    claim = Claim(source, result["unit"]["serial"], result=result)
    claim.digests = {"log": result["log"].get("sha256", ""), "configuration": result.get("configuration_sha256", "")}
    rows = result["parameters"].items()
    claim.values = {name: (row["value"], row["sigma"]) for name, row in rows if name in NAMES}
    for one, row in result.get("correlation", {}).items():
        claim.correlation.update({(one, other): value for other, value in row.items()})
    for check in result.get("checks", []):
        if check.get("kind") in ("within", "sigma_below"):
            claim.decisions[check["subject"], check["kind"]] = bool(check["passed"])
    claim.verdict = {True: "pass", False: "fail"}.get(result.get("passed"))
    return claim


def _local(element):
    return element.tag.rpartition("}")[2]


def _texts(element, name):
    return [(e.text or "").split() for e in element.iter() if _local(e) == name]


def _dcc(data, source):
    """Return what a digital calibration certificate states."""
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise ValueError("the certificate defines entities")
    root = ElementTree.fromstring(data)
    if _local(root) != "digitalCalibrationCertificate":
        raise ValueError("it is no digital calibration certificate")
    claim = Claim(source)
    for core in (e for e in root.iter() if _local(e) == "coreData"):
        claim.digests["log"] = next(
            iter(w[0] for w in _texts(core, "value") if w and re.fullmatch("[0-9a-f]{64}", w[0])), ""
        )
    items = next(e for e in root.iter() if _local(e) == "items")
    claim.serial = next(" ".join(words) for words in _texts(items, "value"))
    for statement in (e for e in root.iter() if _local(e) == "statement"):
        if statement.get("refType") == "basic_conformity":
            claim.verdict = next((words[0] for words in _texts(statement, "conformity") if words), None)
    for quantity in (e for e in root.iter() if _local(e) == "quantity" and e.get("refType") == "basic_measuredValue"):
        values = next(e for e in quantity if _local(e) == "realListXMLList")
        names, numbers = (_texts(values, tag)[0] for tag in ("labelXMLList", "valueXMLList"))
        factors, widths = (_texts(values, tag) for tag in ("coverageFactorXMLList", "uncertaintyXMLList"))
        sigmas = [float(w) / float(factors[0][0]) for w in widths[0]] if widths else [math.nan] * len(names)
        if len(numbers) == 1:
            numbers *= len(names)
        if len(sigmas) == 1:
            sigmas *= len(names)
        rows = zip(names, map(float, numbers), sigmas, strict=True)
        claim.values.update({name: (value, sigma) for name, value, sigma in rows if name in NAMES})
        for decided in _texts(quantity, "conformityXMLList")[:1]:
            claim.decisions.update({(n, ""): word == "pass" for n, word in zip(names, decided, strict=True)})
    for joint in (e for e in root.iter() if _local(e) == "realList"):
        names = [words[0] for words in _texts(joint, "label")]
        if len(names) != sum(_local(e) == "column" for e in joint.iter()):
            continue
        matrix = [[float(v[0]) for v in _texts(c, "value")] for c in joint.iter() if _local(c) == "column"]
        stated = [float(v[0]) for e in joint if _local(e) == "real" for v in _texts(e, "value")[:1]]
        for name, value, variance in zip(names, stated, (matrix[k][k] for k in range(len(names))), strict=True):
            if name in claim.values and not _same((value, math.sqrt(variance)), claim.values[name]):
                raise ValueError(f"{name} differs between the list and the joint estimate")
        for i, one in enumerate(names):
            for j, other in enumerate(names[:i]):
                scale = math.sqrt(matrix[i][i] * matrix[j][j])
                claim.correlation[one, other] = matrix[i][j] / scale if scale else 0.0
    return claim


def _same(one, other):
    return all(math.isclose(a, b, rel_tol=1e-6, abs_tol=1e-30) for a, b in zip(one, other, strict=True))


def contradictions(claims):
    """Yield (subject, text) where two documents of one certificate differ."""
    first = claims[0]
    for other in claims[1:]:
        for key in ("serial", "verdict"):
            stated = {getattr(claim, key) for claim in (first, other)}  # a partial certificate states no verdict
            if len(stated - {None}) > 1:
                yield key, f"{first.source} states {getattr(first, key)}, {other.source} {getattr(other, key)}"
        for name in sorted(first.values.keys() | other.values.keys()):
            one, two = first.values.get(name), other.values.get(name)
            if one is None or two is None or not _same(one, two):
                yield name, f"{first.source} states {one}, {other.source} {two}"
