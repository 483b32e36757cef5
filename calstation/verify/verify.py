"""Comparison of a certificate, or the result in a log, with an independent solution of the log."""

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from .claims import DAMAGED, contradictions, read_claims, result_claim
from .estimate import Joint, position_equations, rate_equations, solve
from .model import AT, BIASES, COUNT, GROUP, NAMES
from .navigation import motion_equations
from .samples import NotCoveredError, UnreadableError, read_log, stages_of

#: Largest difference in standard deviations, of sigmas as a ratio, and of correlation coefficients.
VALUE, SIGMA, CORRELATION = 0.1, 0.02, 0.05
#: Ratio to the profile's noise below which the table is quiet, see `Solution.table`.
QUIET = 0.8
#: Equations and estimated parameters of the stages.
STAGES = {
    "rate": (rate_equations, AT["gyro_scale"]),
    "six_position": (position_equations, AT["accel_scale"] + AT["accel_bias"]),
    "excitation": (motion_equations, [*range(COUNT)]),
    "designed": (motion_equations, [*range(COUNT)]),
    "azimuth_flip": (motion_equations, BIASES),
}
WORDS = {True: "pass", False: "fail"}
#: Exit codes: all agrees, something does not, a file cannot be read, the log needs what this program does not compute.
AGREES, DIFFERS, UNREADABLE, NOT_COVERED = 0, 1, 2, 5


class Solution:
    """The independent estimate of a log, and what follows from it."""

    def __init__(self, log, result):
        """Solve the stages of a result in their order, with the table's noise in each as the run measured it."""
        checks, s, self.stage, self.meta = result.get("checks", []), log.setting, {}, log.setting.meta
        if any(check.get("kind") == "imu_noise" and check["value"] > 1.0 + 1e-9 for check in checks):
            raise NotCoveredError("a unit that is noisier than its profile, whose sigmas the run has increased")
        noise = {check["subject"]: check["value"] for check in checks if check.get("kind") == "table_noise"}
        recorded = stages_of(log, result["log"].get("first_seq", 0), result["log"].get("last_seq", 2**62))
        joint, velocity, self.prior = Joint.prior(s.mean, s.covariance), s.velocity, np.sqrt(np.diag(s.covariance))
        for name in result.get("stages", []):
            if name not in STAGES:
                raise NotCoveredError(f"the method {name}")
            if name not in recorded:
                raise UnreadableError(f"the log has no samples of the stage {name}")
            linearise, estimated = STAGES[name]
            s.velocity = velocity * max(noise.get(name, 1.0), 1.0) ** 2
            joint = solve(name, linearise(recorded[name], s, joint), joint, estimated)
            self.stage |= {i: name for i in estimated if self.prior[i] > 0.0}
        self.mean, covariance, offsets = joint.complete(s.offset, s.offset_sigma, s.gravity_sigma / s.gravity)
        self.sigma = np.sqrt(np.diag(covariance))
        scale = np.where(self.sigma > 0.0, self.sigma, 1.0)
        self.correlation = covariance / np.outer(scale, scale)
        # on a quiet table, the product determines the offsets of the axes with the noise that it measured
        self.share = np.sqrt(np.diag(offsets)) / scale * any(ratio < QUIET for ratio in noise.values())

    def table(self):
        """Return what a claim should state: (kind, subject) -> (value, smallest, largest) that agree."""
        rows = {}
        for i in (i for i in self.stage if self.sigma[i] > 0.0):
            name, mean, sigma, share = NAMES[i], float(self.mean[i]), float(self.sigma[i]), float(self.share[i])
            width, narrow = (VALUE + share) * sigma, np.sqrt(max(1.0 - share**2, 0.0)) - SIGMA
            rows["value", name] = mean, mean - width, mean + width
            rows["sigma", name] = sigma, narrow * sigma, (1.0 + SIGMA) * sigma
            for j in self.stage:
                value, width = float(self.correlation[i, j]), CORRELATION + 2.0 * max(share, self.share[j])
                rows["correlation", f"{name}, {NAMES[j]}"] = value, value - width, value + width
            decisions = dict(self._decisions(i))
            rows |= {(kind, name): decision for kind, decision in decisions.items()}
            if decisions:
                rows["decision", name] = tuple(all(column) for column in zip(*decisions.values(), strict=True))
        return rows

    def _decisions(self, i):
        """Yield the kind and the decision on a parameter: whether it passes, certainly, and possibly."""
        product, sigma = self.meta.get("product") or {}, self.sigma[i]
        limits, guard = product.get("limits", {}), 2.0 * ((product.get("conformity") or {}).get("rule") == "guard_band")
        limit = limits.get(NAMES[i], limits.get(GROUP[i]))
        if limit is None or sigma > 0.9 * self.prior[i]:
            return
        margins, within = {}, limit.get("within")
        if within is not None:
            low, high = within if isinstance(within, list) else (-within, within)
            margin = min(self.mean[i] - low, high - self.mean[i]) - guard * sigma
            margins["within"] = margin, (VALUE + guard * SIGMA) * sigma
        largest = limit.get("sigma_below_after", {}).get(self.stage[i], limit.get("sigma_below"))
        if largest is not None:
            margins["sigma_below"] = largest - sigma, SIGMA * sigma
        for kind, (margin, tolerance) in margins.items():
            yield kind, (bool(margin >= 0.0), bool(margin >= tolerance), bool(margin > -tolerance))


def verify(source, log_path=None):
    """Return the comparison as JSON values. Raises UnreadableError and NotCoveredError."""
    source = Path(source)
    claims = [] if source.suffix == ".h5" else read_claims(source)
    log = read_log(_find_log(source, claims, log_path) if claims else source)
    stored = [result for result in log.results if result.get("parameters")][-1:]
    if not claims:
        if not stored:
            raise UnreadableError(f"{source} contains no result; give a certificate or a result of this log")
        claims = [result_claim(stored[0], source.name)]
    result = next((claim.result for claim in claims if claim.result), *stored or [None])
    if result is None:
        raise UnreadableError(f"neither {source} nor the log names the stages that were solved")
    try:
        solution = Solution(log, result)
    except np.linalg.LinAlgError as exc:
        raise NotCoveredError(f"a log without a solution ({exc})") from exc
    serial, own = log.setting.meta["imu"]["serial"], solution.table()
    given = {("serial", "unit"): serial} | {("digest", key): digest for key, digest in log.digests.items()}
    own |= {key: (value, value, value) for key, value in given.items()}
    rows, parameters = [*contradictions(claims)], {}
    if log.closed not in (None, log.digests["log"]):
        rows += [("digest", "log", "samples or configuration were changed after the log was closed")]
    decided = {" ".join(key[::-1]): row for key, row in own.items() if key[0] in ("within", "sigma_below")}
    failed = [name for name, (_, _, possibly) in decided.items() if not possibly]
    failed += [check["name"] for check in result.get("checks", []) if not check["passed"]]
    is_certain = all(certainly for _, certainly, _ in decided.values())
    for claim in claims:
        is_partial = claim.result is None and bool(result.get("partial"))
        reasons = failed + ["stages of the product that were omitted"] * is_partial
        own["verdict", "unit"] = not reasons, is_certain and not reasons, not reasons
        rows += _compare(claim, own, solution, reasons)
        for name in (name for kind, name in own if kind == "value" and (kind, name) in claim.table):
            (value, mean), (width, sigma) = ((claim.table[k, name], own[k, name][0]) for k in ("value", "sigma"))
            row = {"stated": [value, width], "own": [mean, sigma], "difference": (value - mean) / sigma}
            parameters.setdefault(name, row | {"sigma_ratio": width / sigma})
    limits = WORDS[all(passed for passed, *_ in decided.values())] if decided else None
    return {
        "schema": "calstation.verify/1", "source": str(source), "serial": serial,
        "log": log.digests, "agrees": not rows, "parameters": parameters,
        "verdict": {"stated": WORDS.get(claims[0].table.get(("verdict", "unit"))), "limits": limits},
        "largest": max((abs(row["difference"]) for row in parameters.values()), default=None),
        "findings": [dict(zip(("code", "subject", "text"), row, strict=True)) for row in rows],
    }  # fmt: skip


def _compare(claim, own, solution, reasons):
    """Yield (code, subject, text) for every statement of a claim that differs from the own table, or lacks in it."""
    missing = [name for kind, name in own if kind == "value" and (kind, name) not in claim.table]
    yield from (("missing", name, f"{claim.source} does not state it") for name in missing)
    for (kind, name), stated in claim.table.items():
        value, low, high = own.get((kind, name), (stated, stated, stated))
        if not low <= stated <= high:
            text = f"{claim.source} states a {kind} of {_text(stated)}, the log gives {_text(value)}"
            reason = f" ({', '.join(reasons[:5])})" if reasons and kind == "verdict" else ""
            yield "decision" if kind in ("within", "sigma_below") else kind, name, text + reason
        if kind == "value" and (kind, name) not in own and solution.prior[NAMES.index(name)]:
            yield "unfounded", name, f"{claim.source} states it, but no stage of the run determines it"


def _text(value):
    return WORDS[value] if isinstance(value, bool) else str(value)


def _find_log(source, claims, log_path):
    """Return the log of a certificate: the given one, or the one beside it."""
    if log_path is not None:
        return Path(log_path)
    for claim in claims:
        stated = Path((claim.result or {}).get("log", {}).get("file", ""))
        for path in (source.parent / stated.name, stated, source.with_suffix(".h5")):
            if path.suffix == ".h5" and path.is_file():
                return path
    raise UnreadableError(f"the log of {source} is not beside it; give it by --log")


def show(report):
    """Print the comparison as a table."""
    print(f"{'parameter':<20}{'stated':>15}{'own':>15}{'sigma':>12}{'difference':>12}{'sigma ratio':>13}")
    for name, row in report["parameters"].items():
        numbers = f"{row['stated'][0]:>15.6e}{row['own'][0]:>15.6e}{row['own'][1]:>12.2e}"
        print(f"{name:<20}{numbers}{row['difference']:>+12.4f}{row['sigma_ratio']:>13.4f}")
    for finding in report["findings"]:
        print(f"{finding['code']}: {finding['subject']}: {_printable(finding['text'])}")
    print(f"log {report['log']['log']}")
    print("verdict stated: {stated}; limits by own values: {limits}".format(**report["verdict"]))
    print("The log agrees." if report["agrees"] else f"The log does not agree: {len(report['findings'])} findings.")


def _printable(text):
    return "".join(c if c.isprintable() else "?" for c in text)


def main(arguments: list[str] | None = None) -> int:
    """Run the program and return its exit code, see `AGREES`."""
    parser = argparse.ArgumentParser(
        prog="verify", description="Solve a log independently and compare its certificate."
    )
    parser.add_argument("source", metavar="CERTIFICATE.pdf|DCC.xml|RESULT.json|LOG.h5")
    parser.add_argument("--log", metavar="LOG.h5", help="log of the certificate, if it is not beside it")
    parser.add_argument("--json", metavar="FILE|-", help="write the comparison as JSON")
    options = parser.parse_args(arguments)
    try:
        report = verify(options.source, options.log)
        text = json.dumps(report, indent=1)
        if options.json and options.json != "-":
            Path(options.json).write_text(text, encoding="utf-8")
    except NotCoveredError as exc:
        code, reason = NOT_COVERED, f"This program does not cover {exc}."
    except (UnreadableError, OSError) as exc:
        code, reason = UNREADABLE, str(exc)
    except DAMAGED as exc:
        code, reason = UNREADABLE, f"{options.source} has an entry of another kind than expected: {exc!r}"
    else:
        print(text) if options.json == "-" else show(report)
        return AGREES if report["agrees"] else DIFFERS
    print(f"verify: {_printable(reason)}", file=sys.stderr)
    return code
