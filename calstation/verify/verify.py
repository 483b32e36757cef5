"""Comparison of a certificate, or the result in a log, with an independent solution of the log."""

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from .claims import DAMAGED, contradictions, read_claims, result_claim
from .estimate import Joint, solve_positions, solve_rate
from .model import AT, COUNT, GROUPS, NAMES
from .navigation import solve_motion
from .samples import NotCoveredError, UnreadableError, read_log, stages_of

#: Largest difference in standard deviations, of sigmas as a ratio, and of correlation coefficients.
VALUE, SIGMA, CORRELATION = 0.1, 0.02, 0.05
#: Ratio to the profile's noise below which the table is quiet, see `_values`.
QUIET = 0.8
#: Solvers and estimated parameters of the stages.
STAGES = {
    "rate": (solve_rate, AT["gyro_scale"]),
    "six_position": (solve_positions, [*AT["accel_scale"], *AT["accel_bias"]]),
    "excitation": (solve_motion, range(COUNT)),
    "designed": (solve_motion, range(COUNT)),
    "azimuth_flip": (solve_motion, [*AT["gyro_bias"], *AT["accel_bias"]]),
}
#: Exit codes: all agrees, something does not, a file cannot be read, the log needs what this program does not compute.
AGREES, DIFFERS, UNREADABLE, NOT_COVERED = 0, 1, 2, 5


class Solution:
    """The independent estimate of a log."""

    def __init__(self, log, stages, noise):
        """Solve the stages in the order of `stages`; `noise` is the ratio to the noise of the table by stage."""
        setting, recorded = log.setting, stages_of(log)
        self.prior = np.sqrt(np.diag(setting.covariance))
        self.stage, velocity, joint = {}, setting.velocity, Joint.prior(setting)
        for name in stages:
            if name not in STAGES:
                raise NotCoveredError(f"the method {name}")
            if name not in recorded:
                raise UnreadableError(f"the log has no samples of the stage {name}")
            solver, estimated = STAGES[name]
            setting.velocity = velocity * max(noise.get(name, 1.0), 1.0) ** 2
            joint = solver(recorded[name], setting, joint).keeping(joint, list(estimated))
            self.stage.update({NAMES[i]: name for i in estimated if self.prior[i] > 0.0})
        shift = setting.gravity_sigma * joint.gravity[:COUNT]
        covariance = joint.covariance[:COUNT, :COUNT] + np.outer(shift, shift)
        self.mean, self.sigma = joint.mean[:COUNT], np.sqrt(np.diag(covariance))
        scale = np.where(self.sigma > 0.0, self.sigma, 1.0)
        self.correlation = covariance / np.outer(scale, scale)
        # the part of each sigma that is due to the offsets of the table's axes
        part = joint.covariance[:COUNT, COUNT:] / np.fmax(joint.sigma[COUNT:], 1e-300)
        self.offset_share = np.linalg.norm(part, axis=1) / scale

    def decisions(self, product):
        """Return (name, kind) -> (passed, whether a tolerable difference may change it) for the limits of a product."""
        decided, guard = {}, 2.0 if (product.get("conformity") or {}).get("rule") == "guard_band" else 0.0
        limits = product.get("limits", {})
        for i, name in enumerate(NAMES):
            group = next(g for g in GROUPS if i in AT[g])
            limit, stage, sigma = limits.get(name, limits.get(group)), self.stage.get(name), self.sigma[i]
            if limit is None or stage is None or sigma > 0.9 * self.prior[i]:
                continue
            within = limit.get("within")
            if within is not None:
                low, high = within if isinstance(within, list) else (-within, within)
                margin = min(self.mean[i] - low, high - self.mean[i]) - guard * sigma
                decided[name, "within"] = margin >= 0.0, abs(margin) < (VALUE + guard * SIGMA) * sigma
            largest = limit.get("sigma_below_after", {}).get(stage, limit.get("sigma_below"))
            if largest is not None:
                decided[name, "sigma_below"] = sigma <= largest, abs(sigma - largest) < SIGMA * sigma
        return decided


def verify(source, log_path=None):
    """Return the comparison as JSON values. Raises UnreadableError and NotCoveredError."""
    source = Path(source)
    is_log = source.suffix == ".h5"
    claims = [] if is_log else read_claims(source)
    log = read_log(source if is_log else find_log(source, claims, log_path))
    stored = [result for result in log.results if result.get("parameters")][-1:]
    if is_log:
        if not stored:
            raise UnreadableError(f"{source} contains no result; give a certificate or a result of this log")
        claims = [result_claim(stored[0], source.name)]
    result = next((claim.result for claim in claims if claim.result), *stored or [None])
    if result is None:
        raise UnreadableError(f"neither {source} nor the log names the stages that were solved")
    findings = [*_finding("contradiction", contradictions(claims)), *_finding("digest", _digests(log, claims))]
    serial, noise = log.setting.meta["imu"]["serial"], _noise(result)
    others = [(c.serial, f"{c.source} is about {c.serial}, the log about {serial}") for c in claims]
    findings += _finding("serial", [(stated, text) for stated, text in others if stated not in (None, serial)])
    first, last = result["log"].get("first_seq", 0), result["log"].get("last_seq", np.iinfo(np.int64).max)
    log.rows = log.rows[(log.rows["seq"] >= first) & (log.rows["seq"] <= last)]
    try:
        solution = Solution(log, result.get("stages", []), noise)
    except np.linalg.LinAlgError as exc:
        raise NotCoveredError(f"a log without a solution ({exc})") from exc
    parameters, decided = {}, solution.decisions(log.setting.meta.get("product") or {})
    quiet = any(ratio < QUIET for ratio in noise.values())
    for claim in claims:
        findings += _values(claim, solution, parameters, quiet)
    for claim in claims:
        findings += _verdict(claim, result, decided)
    limits = ("pass" if all(passed for passed, _ in decided.values()) else "fail") if decided else None
    return {
        "schema": "calstation.verify/1", "source": str(source), "serial": serial,
        "log": log.digests, "agrees": not findings, "parameters": parameters,
        "verdict": {"stated": claims[0].verdict, "limits": limits},
        "largest": max((abs(row["difference"]) for row in parameters.values()), default=None), "findings": findings,
    }  # fmt: skip


def find_log(source, claims, log_path):
    """Return the log of a certificate: the given one, or the one beside it with the certificate's digest."""
    if log_path is not None:
        return Path(log_path)
    for claim in claims:
        stated = Path((claim.result or {}).get("log", {}).get("file", ""))
        for path in (source.parent / stated.name, stated, source.with_suffix(".h5")):
            if path.suffix == ".h5" and path.is_file():
                return path
    raise UnreadableError(f"the log of {source} is not beside it; give it by --log")


def _finding(code, rows):
    return [{"code": code, "subject": subject, "text": text} for subject, text in rows]


def _noise(result):
    """Return the ratio of the table's noise to its profile by stage, as the run measured it. Raises NotCoveredError."""
    checks = result.get("checks", [])
    if any(check.get("kind") == "imu_noise" and check["value"] > 1.0 + 1e-9 for check in checks):
        raise NotCoveredError("a unit that is noisier than its profile, whose sigmas the run has increased")
    return {check["subject"]: check["value"] for check in checks if check.get("kind") == "table_noise"}


def _digests(log, claims):
    if log.damaged:
        yield "samples", f"{log.damaged} rows have a wrong checksum"
    if log.closing and log.closing.get("sha256") != log.digests["log"]:
        yield "log", "samples or configuration were changed after the log was closed"
    for claim in claims:
        for key, stated in claim.digests.items():
            if stated and stated != log.digests[key]:
                yield key, f"{claim.source} is about another {key}: {stated[:16]}..., not {log.digests[key][:16]}..."


def _values(claim, solution, parameters, quiet):
    """Compare values, sigmas and correlations of a claim, and add them to `parameters`; return findings.

    On a `quiet` table, the product determines the offsets of the axes with the noise that it measured.
    """
    share, source, rows = solution.offset_share * quiet, claim.source, []
    missing = [name for name in solution.stage if name not in claim.values]
    rows += _finding("missing", [(name, f"{source} does not state it") for name in missing])
    for name, (value, sigma) in claim.values.items():
        i = NAMES.index(name)
        mean, own = float(solution.mean[i]), float(solution.sigma[i])
        if name not in solution.stage and solution.prior[i]:
            rows += _finding("unfounded", [(name, f"{source} states it, but no stage of the run determines it")])
        if name not in solution.stage or not own:
            continue
        difference, ratio = (value - mean) / own, sigma / own
        row = {"stated": [value, sigma], "own": [mean, own], "difference": difference, "sigma_ratio": ratio}
        parameters.setdefault(name, row)
        if not abs(difference) <= VALUE + share[i]:
            text = f"{source} states {value:.6g}, the samples give {mean:.6g} ({difference:+.2f} sigma)"
            rows += _finding("value", [(name, text)])
        if not np.sqrt(max(1.0 - share[i] ** 2, 0.0)) - SIGMA <= ratio <= 1.0 + SIGMA:
            rows += _finding("sigma", [(name, f"{source} states a sigma of {sigma:.4g}, the samples give {own:.4g}")])
    for (one, other), stated in claim.correlation.items():
        if one in solution.stage and other in solution.stage:
            i, j = NAMES.index(one), NAMES.index(other)
            if not abs(stated - solution.correlation[i, j]) <= CORRELATION + 2.0 * max(share[i], share[j]):
                text = f"{source} states {stated:.3f}, the samples give {solution.correlation[i, j]:.3f}"
                rows += _finding("correlation", [(f"{one}, {other}", text)])
    return rows


def _verdict(claim, result, decided):
    """Compare the decisions of a claim on single values, and its verdict; return findings."""
    rows, source = [], claim.source
    for (name, kind), stated in claim.decisions.items():
        own = [decided[name, k] for k in ([kind] if kind else ["within", "sigma_below"]) if (name, k) in decided]
        if own and not any(near for _, near in own) and all(passed for passed, _ in own) != stated:
            text = f"{source} states {'pass' if stated else 'fail'} ({kind or 'limits'}), the samples do not"
            rows += _finding("decision", [(name, text)])
    failed = [f"{name} {kind}" for (name, kind), (passed, near) in decided.items() if not passed and not near]
    failed += [check["name"] for check in result.get("checks", []) if not check["passed"]]
    if claim.verdict == "pass" and claim.result is None and result.get("partial"):
        rows += _finding("verdict", [("pass", f"{source} states pass, but the run omitted stages of the product")])
    if claim.verdict == "pass" and failed:
        rows += _finding("verdict", [("pass", f"{source} states pass, but these failed: {', '.join(failed[:5])}")])
    if claim.verdict == "fail" and not failed and not any(near for _, near in decided.values()):
        text = f"{source} states fail, but every value is within its limits and no check failed"
        rows += _finding("verdict", [("fail", text)])
    return rows


def show(report):
    """Print the comparison as a table."""
    print(f"{'parameter':<20}{'stated':>15}{'own':>15}{'sigma':>12}{'difference':>12}{'sigma ratio':>13}")
    for name, row in report["parameters"].items():
        own, sigma = row["own"]
        print(f"{name:<20}{row['stated'][0]:>15.6e}{own:>15.6e}{sigma:>12.2e}", end="")
        print(f"{row['difference']:>+12.4f}{row['sigma_ratio']:>13.4f}")
    for finding in report["findings"]:
        print(f"{finding['code']}: {finding['subject']}: {_printable(finding['text'])}")
    verdict, count = report["verdict"], len(report["findings"])
    print(f"log {report['log']['log']}")
    print(f"verdict stated: {verdict['stated']}; limits by own values: {verdict['limits']}")
    print("The log agrees." if report["agrees"] else f"The log does not agree: {count} findings.")


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
    options, reason = parser.parse_args(arguments), ""
    try:
        report = verify(options.source, options.log)
        if options.json and options.json != "-":
            Path(options.json).write_text(json.dumps(report, indent=1), encoding="utf-8")
    except NotCoveredError as exc:
        print(_printable(f"verify: This program does not cover {exc}."), file=sys.stderr)
        return NOT_COVERED
    except (UnreadableError, OSError) as exc:
        reason = str(exc)
    except DAMAGED as exc:
        reason = f"{options.source} has an entry of another kind than expected: {exc!r}"
    if reason:
        print(f"verify: {_printable(reason)}", file=sys.stderr)
        return UNREADABLE
    if options.json == "-":
        print(json.dumps(report, indent=1))
    else:
        show(report)
    return AGREES if report["agrees"] else DIFFERS
