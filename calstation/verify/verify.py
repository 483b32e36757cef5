"""Comparison of a certificate, or the result in a log, with an independent solution of the log.

A statement has a kind (digest, serial, verdict, value, sigma, correlation, within, sigma_below, decision) and subject.
"""

import argparse
import json
import math
import re
import sys
import zlib
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np

from .estimate import Joint, motion_equations, position_equations, rate_equations, solve
from .samples import AT, BIASES, COUNT, DAMAGED, GROUP, NAMES, NotCoveredError, UnreadableError, read_log, stages_of
from .temperature import OverTemperature, coefficients

#: Largest difference in standard deviations, of sigmas as a ratio, and of correlation coefficients.
VALUE, SIGMA, CORRELATION = 0.1, 0.02, 0.05
#: Equations and estimated parameters of the stages.
STAGES = {
    "rate": (rate_equations, AT["gyro_scale"]),
    "six_position": (position_equations, AT["accel_scale"] + AT["accel_bias"]),
    "azimuth_flip": (motion_equations, BIASES),
    "temperature": (OverTemperature, [*range(COUNT)]),
} | dict.fromkeys(("excitation", "designed"), (motion_equations, [*range(COUNT)]))
#: Exit codes: all agrees, something does not, a file cannot be read, the log needs what this program does not compute.
AGREES, DIFFERS, UNREADABLE, NOT_COVERED = 0, 1, 2, 5
#: Kinds of decisions, and largest file and largest attachment, bytes.
DECISIONS, LARGEST = ("within", "sigma_below"), 200_000_000


def read_claims(path):
    """Return the statements of a PDF (its attachments), a DCC or a result JSON. Raises UnreadableError."""
    try:
        if path.stat().st_size > LARGEST:
            raise UnreadableError(f"{path} is larger than {LARGEST} bytes")
        data, claims = path.read_bytes(), []
        for part in _attachments(data) if data.startswith(b"%PDF") else [data]:
            result = json.loads(part) if part.lstrip().startswith(b"{") else None
            for kind, table in {"JSON": _result(result)}.items() if result else _dcc(part.lstrip()).items():
                claims.append(SimpleNamespace(source=f"{path.name} ({kind})", table=table, result=result))
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
            yield zlib.decompressobj().decompress(packed, LARGEST)
        elif b"endobj" not in match[1]:
            yield packed[: packed.index(b"endstream")].rstrip(b"\r\n")


def _result(result):
    """Return what a result JSON states."""
    table = {("serial", "unit"): result["unit"]["serial"], ("verdict", "unit"): result.get("passed")}
    table["digest", "log"] = result["log"].get("sha256")
    table["digest", "configuration"] = result.get("configuration_sha256")
    rows = {name: row for name, row in result["parameters"].items() if name in NAMES}
    table |= {(kind, name): float(row[kind]) for name, row in rows.items() for kind in ("value", "sigma")}
    for one, row in result.get("correlation", {}).items():
        table |= {("correlation", f"{one}, {other}"): float(value) for other, value in row.items()}
    table |= _joint(*coefficients(result.get("temperature", {})))
    checks = [check for check in result.get("checks", []) if check.get("kind") in DECISIONS]
    table |= {(check["kind"], check["subject"]): bool(check["passed"]) for check in checks}
    return {key: value for key, value in table.items() if value is not None}


def _joint(values, covariance):
    """Return the statements of named values with a covariance matrix."""
    table = {}
    for k, (name, value) in enumerate(values):
        table["value", name], table["sigma", name] = value, math.sqrt(covariance[k][k])
        for j, (other, _) in enumerate(values[:k]):
            scale = table["sigma", name] * table["sigma", other]
            table["correlation", f"{name}, {other}"] = covariance[k][j] / scale if scale else 0.0
    return table


def _words(element, tag):
    return element.findtext(f".//{{*}}{tag}", "").split()


def _dcc(data):
    """Return what a digital calibration certificate states, and what its joint estimate states."""
    root = None if b"<!DOCTYPE" in data or b"<!ENTITY" in data else ElementTree.fromstring(data)
    if root is None or not root.tag.endswith("}digitalCalibrationCertificate"):
        raise ValueError("it is no digital calibration certificate, or it defines entities")
    table, joint = {("serial", "unit"): " ".join(_words(root.find(".//{*}items"), "value"))}, {}
    identifications = [(e.text or "").strip() for e in root.iterfind(".//{*}coreData//{*}value")]
    for digest in [text for text in identifications if re.fullmatch("[0-9a-f]{64}", text)][:1]:
        table["digest", "log"] = digest
    for conformity in root.iterfind(".//{*}statement[@refType='basic_conformity']//{*}conformity"):
        table["verdict", "unit"] = conformity.text.strip() == "pass"
    for quantity in root.iterfind(".//{*}quantity[@refType='basic_measuredValue']"):
        names, factor = _words(quantity, "labelXMLList"), _words(quantity, "coverageFactorXMLList")
        columns = {"value": [float(word) for word in _words(quantity, "valueXMLList")]}
        columns["sigma"] = [float(w) / float(factor[0]) for w in _words(quantity, "uncertaintyXMLList")] or [math.nan]
        columns["decision"] = [word == "pass" for word in _words(quantity, "conformityXMLList")]
        for kind, column in columns.items():
            rows = zip(names, column * len(names) if len(column) == 1 else column, strict=bool(column))  # one for all
            table |= {(kind, name): value for name, value in rows if name in NAMES}
    for block in root.iterfind(".//{*}realList"):
        reals = [(_words(real, "label")[0], float(_words(real, "value")[0])) for real in block.findall("{*}real")]
        matrix = [[float(e.text) for e in column.iterfind(".//{*}value")] for column in block.findall(".//{*}column")]
        joint |= _joint(reals, matrix) if len(reals) == len(matrix) else {}
    return {"DCC": table} | ({"DCC, joint estimate": joint} if joint else {})


class Solution:
    """The independent estimate of the stages of a result, with the table's noise in each as the run measured it."""

    def __init__(self, log, result):
        checks, s, self.stage, self.over, self.meta = result.get("checks", []), log.setting, {}, None, log.setting.meta
        if any(check.get("kind") == "imu_noise" and check["value"] > 1.0 + 1e-9 for check in checks):
            raise NotCoveredError("a unit that is noisier than its profile, whose sigmas the run has increased")
        noise = {check["subject"]: check["value"] for check in checks if check.get("kind") == "table_noise"}
        recorded = stages_of(log, result["log"].get("first_seq", 0), result["log"].get("last_seq", 2**62))
        joint, velocity = Joint(np.outer(s.mean, [0.0, 0.0, 0.0, 1.0]), s.covariance, np.zeros((0, 4))), s.velocity
        self.prior = joint.sigma
        for name in result.get("stages", []):
            if name not in STAGES:
                raise NotCoveredError(f"the method {name}")
            if name not in recorded:
                raise UnreadableError(f"the log has no samples of the stage {name}")
            linearise, estimated = STAGES[name]
            self.stage |= {i: name for i in estimated if self.prior[i] > 0.0}
            if linearise is OverTemperature:  # the only stage of its run
                joint = self.over = OverTemperature(log, recorded[name], result["temperature"], joint)
                continue
            s.velocity = velocity * max(noise.get(name, 1.0), 1.0) ** 2
            joint = solve(name, linearise(recorded[name], s, joint), joint, estimated)
        self.names = NAMES + (self.over.names if self.over else ())
        self.mean, covariance, part = joint.complete(s.offset, s.offset_sigma, s.gravity_sigma / s.gravity)
        self.sigma = np.sqrt(np.diag(covariance))
        scale = np.where(self.sigma > 0.0, self.sigma, 1.0)
        self.covariance, self.correlation = covariance, covariance / np.outer(scale, scale)
        # on a quiet table, the product determines the offsets of the axes with the noise that it measured
        self.share = np.sqrt(np.diag(part)) / scale * any(ratio < 0.8 for ratio in noise.values())

    def table(self):
        """Return what a document should state: (kind, subject) -> (value, smallest, largest) that agree."""
        rows, determined = {}, [*self.stage, *range(COUNT, len(self.names))]
        for i in (i for i in determined if self.sigma[i] > 0.0):
            name, mean, sigma, share = self.names[i], float(self.mean[i]), float(self.sigma[i]), float(self.share[i])
            width, narrow = (VALUE + share) * sigma, np.sqrt(max(1.0 - share**2, 0.0)) - SIGMA
            rows["value", name] = mean, mean - width, mean + width
            rows["sigma", name] = sigma, narrow * sigma, (1.0 + SIGMA) * sigma
            for j in determined:
                value, width = float(self.correlation[i, j]), CORRELATION + 2.0 * max(share, self.share[j])
                rows["correlation", f"{name}, {self.names[j]}"] = value, value - width, value + width
            margins = self._margins(i) if i < COUNT else ()
            decisions = {(kind, name): (m >= 0.0, m >= t, m > -t) for kind, m, t in margins}
            if decisions:
                rows |= decisions | {("decision", name): tuple(map(all, zip(*decisions.values(), strict=True)))}
        return rows

    def _margins(self, i):
        """Yield the kind, margin and tolerance of the limits of a parameter that the run determines."""
        product = self.meta.get("product") or {}
        by_unknowns = self.over.over_range(i) if self.over else np.eye(COUNT)[[i]]
        values, variances = by_unknowns @ self.mean, np.sum(by_unknowns @ self.covariance * by_unknowns, axis=1)
        sigma = float(np.sqrt(variances.max()))
        limits, guard = product.get("limits", {}), 2.0 * ((product.get("conformity") or {}).get("rule") == "guard_band")
        limit = limits.get(NAMES[i], limits.get(GROUP[i])) if sigma <= 0.9 * self.prior[i] else None
        within = (limit or {}).get("within")
        if within is not None:
            low, high = within if isinstance(within, list) else (-within, within)
            margin = float(min(values.min() - low, high - values.max()))
            yield "within", margin - guard * sigma, (VALUE + guard * SIGMA) * sigma
        largest = (limit or {}).get("sigma_below_after", {}).get(self.stage[i], (limit or {}).get("sigma_below"))
        if largest is not None:
            yield "sigma_below", largest - sigma, SIGMA * sigma


def verify(source, log_path=None):
    """Return the comparison as JSON values. Raises UnreadableError and NotCoveredError."""
    source = Path(source)
    claims = [] if source.suffix == ".h5" else read_claims(source)
    log = read_log(_find_log(source, claims, log_path) if claims else source)
    stored = [result for result in log.results if result.get("parameters")][-1:]
    claims = claims or [SimpleNamespace(source=source.name, table=_result(one), result=one) for one in stored]
    result = next((claim.result for claim in claims if claim.result), *stored or [None])
    if result is None:
        raise UnreadableError(f"neither {source} nor the log contains a result; give a result of this log")
    try:
        solution = Solution(log, result)
    except np.linalg.LinAlgError as exc:
        raise NotCoveredError(f"a log without a solution ({exc})") from exc
    own, serial = solution.table(), log.setting.meta["imu"]["serial"]
    decided = {f"{name} {kind}": row for (kind, name), row in own.items() if kind in DECISIONS}
    failed = [name for name, (_, _, possibly) in decided.items() if not possibly]
    failed += [check["name"] for check in result.get("checks", []) if not check["passed"]]
    is_certain, findings, parameters = all(certainly for _, certainly, _ in decided.values()), [], {}
    own |= {("digest", key): (digest,) * 3 for key, digest in log.digests.items()} | {("serial", "unit"): (serial,) * 3}
    if log.closed not in (None, log.digests["log"]):
        findings += [("digest", "log", "samples or configuration were changed after the log was closed")]
    for claim in claims:
        is_partial = claim.result is None and bool(result.get("partial"))
        reasons = failed + ["stages of the product that were omitted"] * is_partial
        own["verdict", "unit"] = not reasons, is_certain and not reasons, not reasons
        findings += _findings(claim, claims[0], own, solution, reasons)
        for name in (name for kind, name in own if kind == "value" and (kind, name) in claim.table):
            (value, mean), (width, sigma) = ((claim.table[k, name], own[k, name][0]) for k in ("value", "sigma"))
            row = {"stated": [value, width], "own": [mean, sigma], "difference": (value - mean) / sigma}
            parameters.setdefault(name, row | {"sigma_ratio": width / sigma})
    limits = _text(all(passed for passed, *_ in decided.values())) if decided else None
    return {
        "schema": "calstation.verify/1", "source": str(source), "serial": serial, "log": log.digests,
        "agrees": not findings, "parameters": parameters,
        "verdict": {"stated": _text(claims[0].table.get(("verdict", "unit"))), "limits": limits},
        "largest": max((abs(row["difference"]) for row in parameters.values()), default=None),
        "findings": [dict(zip(("code", "subject", "text"), row, strict=True)) for row in findings],
    }  # fmt: skip


def _find_log(source, claims, log_path):
    """Return the log of a certificate: the given one, the one beside it, or one in a folder beside its folder."""
    stated = [Path((claim.result or {}).get("log", {}).get("file", "")) for claim in claims]
    beside = [path for name in stated for path in (source.parent / name.name, name)] + [source.with_suffix(".h5")]
    beside += [path for name in beside for path in sorted(source.absolute().parent.parent.glob(f"*/{name.name}"))]
    found = [Path(log_path)] if log_path else [path for path in beside if path.suffix == ".h5" and path.is_file()]
    if not found:
        raise UnreadableError(f"the log of {source} is not beside it or its folder; give it by --log")
    return found[0]


def _findings(claim, first, own, solution, reasons):
    """Yield (code, subject, text) for every statement that differs from the own table or the first document."""
    has_coefficients = any("[" in name for _, name in claim.table)
    missing = (name for kind, name in own if kind == "value" and (kind, name) not in claim.table)
    for name in (name for name in missing if has_coefficients or "[" not in name):
        yield "missing", name, f"{claim.source} does not state it"
    for (kind, name), stated in claim.table.items():
        value, low, high = own.get((kind, name), (stated, stated, stated))
        if not low <= stated <= high:
            reason = f" ({', '.join(reasons[:5])})" if reasons and kind == "verdict" else ""
            text = f"{claim.source} states a {kind} of {_text(stated)}, the log gives {_text(value)}{reason}"
            yield "decision" if kind in DECISIONS else kind, name, text
        if kind == "value" and (kind, name) not in own and solution.prior[NAMES.index(name.partition("[")[0])]:
            yield "unfounded", name, f"{claim.source} states it, but no stage of the run determines it"
        other = first.table.get((kind, name), stated)
        is_same = math.isclose(other, stated, rel_tol=1e-6) if isinstance(stated, float) else other == stated
        if kind != "correlation" and not is_same:
            yield "contradiction", name, f"{first.source} states a {kind} of {other}, {claim.source} {stated}"


def _text(value):
    return ("pass" if value else "fail") if isinstance(value, bool) else value


def main(arguments: list[str] | None = None) -> int:
    """Run the program and return its exit code, see `AGREES`."""
    parser = argparse.ArgumentParser("verify", description="Solve a log independently and compare its certificate.")
    parser.add_argument("source", metavar="CERTIFICATE.pdf|DCC.xml|RESULT.json|LOG.h5")
    parser.add_argument("--log", metavar="LOG.h5", help="log of the certificate, if it is not beside it or its folder")
    parser.add_argument("--json", metavar="FILE|-", help="write the comparison as JSON")
    options = parser.parse_args(arguments)
    try:
        report = verify(options.source, options.log)
        if options.json not in (None, "-"):
            Path(options.json).write_text(json.dumps(report, indent=1), encoding="utf-8")
        code = AGREES if report["agrees"] else DIFFERS
        lines = json.dumps(report, indent=1).splitlines() if options.json == "-" else _table(report)
    except NotCoveredError as exc:
        code, lines = NOT_COVERED, [f"verify: This program does not cover {exc}."]
    except (UnreadableError, OSError) as exc:
        code, lines = UNREADABLE, [f"verify: {exc}"]
    except DAMAGED as exc:
        code, lines = UNREADABLE, [f"verify: {options.source} has an entry of another kind than expected: {exc!r}"]
    for line in lines:
        printable = "".join(character if character.isprintable() else "?" for character in line)
        print(printable, file=sys.stdout if code in (AGREES, DIFFERS) else sys.stderr)
    return code


def _table(report):
    """Return the comparison as lines of text."""
    lines = [f"{'parameter':<20}{'stated':>15}{'own':>15}{'sigma':>12}{'difference':>12}{'sigma ratio':>13}"]
    columns = "{:<20}{:>15.6e}{:>15.6e}{:>12.2e}{:>+12.4f}{:>13.4f}".format
    for name, row in report["parameters"].items():
        lines.append(columns(name, row["stated"][0], *row["own"], row["difference"], row["sigma_ratio"]))
    lines += ["{code}: {subject}: {text}".format(**finding) for finding in report["findings"]]
    lines += [f"log {report['log']['log']}", "verdict stated: {stated}; limits: {limits}".format(**report["verdict"])]
    agrees = "agrees." if report["agrees"] else f"does not agree: {len(report['findings'])} findings."
    return [*lines, f"The log {agrees}"]
