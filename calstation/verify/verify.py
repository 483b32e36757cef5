"""Comparison of a certificate, or the result in a log, with an independent solution of the log."""

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from .claims import contradictions, read_claims, result_claim
from .estimate import Joint, solve_positions, solve_rate
from .model import AT, COUNT, GROUPS, NAMES
from .navigation import solve_motion
from .samples import NotCoveredError, UnreadableError, read_log, stages_of

#: Largest difference in standard deviations, of sigmas as a ratio, and of correlation coefficients.
VALUE, SIGMA, CORRELATION = 0.1, 0.02, 0.05
#: Ratio to the profile's noise below which the table is quiet, see `_allowance`.
QUIET = 0.8
_BIASES = [*AT["gyro_bias"], *AT["accel_bias"]]
#: Solvers and estimated parameters of the stages.
STAGES = {
    "rate": (solve_rate, AT["gyro_scale"]),
    "six_position": (solve_positions, [*AT["accel_scale"], *AT["accel_bias"]]),
    "excitation": (solve_motion, range(COUNT)),
    "designed": (solve_motion, range(COUNT)),
    "azimuth_flip": (solve_motion, _BIASES),
}


class Solution:
    """The independent estimate of a log."""

    def __init__(self, log, stages, noise):
        """Solve the stages in the order of `stages`; `noise` is the ratio to the noise of the table by stage."""
        setting, recorded = log.setting, {stage.name: stage for stage in stages_of(log)}
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
        self.joint, self.mean = joint, joint.mean[:COUNT]
        self.sigma = joint.final_sigma(setting.gravity_sigma)
        shift = setting.gravity_sigma * joint.gravity[:COUNT]
        scale = np.where(self.sigma > 0.0, self.sigma, 1.0)
        self.correlation = (joint.covariance[:COUNT, :COUNT] + np.outer(shift, shift)) / np.outer(scale, scale)

    def offset_share(self):
        """Return the part of each sigma that is due to the offset of the table's axes, shape (30,)."""
        part = self.joint.covariance[:COUNT, COUNT] / max(self.joint.sigma[COUNT], 1e-300)
        return np.abs(part) / np.where(self.sigma > 0.0, self.sigma, 1.0)

    def decisions(self, product):
        """Return (name, kind) -> (passed, whether a tolerable difference may change it) for the limits of a product."""
        decided, guard = {}, 2.0 if (product.get("conformity") or {}).get("rule") == "guard_band" else 0.0
        limits = product.get("limits", {})
        for i, name in enumerate(NAMES):
            group = next(g for g in GROUPS if i in AT[g])
            limit, stage = limits.get(name, limits.get(group)), self.stage.get(name)
            if limit is None or stage is None or self.sigma[i] > 0.9 * self.prior[i]:
                continue
            within, sigma = limit.get("within"), self.sigma[i]
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
    stored = [result for result in log.results if result.get("parameters")]
    if is_log:
        if not stored:
            raise UnreadableError(f"{source} contains no result; give a certificate or a result of this log")
        claims = [result_claim(stored[-1], source.name)]
    result = next((c.result for c in claims if c.result), stored[-1] if stored else None)
    if result is None:
        raise UnreadableError(f"neither {source} nor the log names the stages that were solved")
    findings = [{"code": "contradiction", "subject": s, "text": t} for s, t in contradictions(claims)]
    _digests(log, claims, findings)
    noise = _noise(result)
    first, last = result["log"].get("first_seq", 0), result["log"].get("last_seq", np.iinfo(np.int64).max)
    log.rows = log.rows[(log.rows["seq"] >= first) & (log.rows["seq"] <= last)]
    try:
        solution = Solution(log, result.get("stages", []), noise)
    except np.linalg.LinAlgError as exc:
        raise NotCoveredError(f"a log without a solution ({exc})") from exc
    parameters = {}
    for claim in claims:
        _values(claim, solution, noise, parameters, findings)
    product = log.setting.meta.get("product") or {}
    decided = solution.decisions(product)
    own = all(passed for passed, _ in decided.values()) if decided else None
    for claim in claims:
        _verdict(claim, result, decided, findings)
    return {
        "schema": "calstation.verify/1", "source": str(source), "serial": log.setting.meta["imu"]["serial"],
        "log": log.digests, "agrees": not findings, "parameters": parameters,
        "verdict": {"stated": claims[0].verdict, "limits": {True: "pass", False: "fail", None: None}[own]},
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


def _noise(result):
    """Return the ratio of the table's noise to its profile by stage, as the run measured it. Raises NotCoveredError."""
    ratios = {}
    for check in result.get("checks", []):
        if check.get("kind") == "imu_noise" and check["value"] > 1.0 + 1e-9:
            raise NotCoveredError("a unit that is noisier than its profile, whose sigmas the run has increased")
        if check.get("kind") == "table_noise":
            ratios[check["subject"]] = check["value"]
    return ratios


def _digests(log, claims, findings):
    def add(subject, text):
        findings.append({"code": "digest", "subject": subject, "text": text})

    if log.damaged:
        add("samples", f"{log.damaged} rows have a wrong checksum")
    if log.closing and log.closing.get("sha256") != log.digests["log"]:
        add("log", "samples or configuration were changed after the log was closed")
    for claim in claims:
        for key, stated in claim.digests.items():
            if stated and stated != log.digests[key]:
                add(key, f"{claim.source} is about another {key}: {stated[:16]}..., not {log.digests[key][:16]}...")
        if claim.serial is not None and claim.serial != log.setting.meta["imu"]["serial"]:
            text = f"{claim.source} is about {claim.serial}, the log about {log.setting.meta['imu']['serial']}"
            findings.append({"code": "serial", "subject": claim.serial, "text": text})


def _values(claim, solution, noise, parameters, findings):
    """Compare values, sigmas and correlations of a claim."""
    quiet = any(ratio < QUIET for ratio in noise.values())
    share = solution.offset_share() if quiet else np.zeros(COUNT)
    for name in solution.stage:
        if name not in claim.values:
            findings.append({"code": "missing", "subject": name, "text": f"{claim.source} does not state it"})
    for name, (value, sigma) in claim.values.items():
        i = NAMES.index(name)
        if name not in solution.stage or not solution.sigma[i]:
            continue
        difference, ratio = (value - solution.mean[i]) / solution.sigma[i], sigma / solution.sigma[i]
        # on a quiet table the product determines the offset of the axes with the noise that it measured
        most, least = VALUE + share[i], np.sqrt(max(1.0 - share[i] ** 2, 0.0)) - SIGMA
        row = {"stated": [value, sigma], "own": [float(solution.mean[i]), float(solution.sigma[i])]}
        parameters.setdefault(name, {**row, "difference": float(difference), "sigma_ratio": float(ratio)})
        if not abs(difference) <= most:
            text = (
                f"{claim.source} states {value:.6g}, the samples give {solution.mean[i]:.6g} ({difference:+.2f} sigma)"
            )
            findings.append({"code": "value", "subject": name, "text": text})
        if not least <= ratio <= 1.0 + SIGMA:
            text = f"{claim.source} states a sigma of {sigma:.4g}, the samples give {solution.sigma[i]:.4g}"
            findings.append({"code": "sigma", "subject": name, "text": text})
    for (one, other), stated in claim.correlation.items():
        if one in solution.stage and other in solution.stage:
            i, j = NAMES.index(one), NAMES.index(other)
            if not abs(stated - solution.correlation[i, j]) <= CORRELATION + 2.0 * max(share[i], share[j]):
                text = f"{claim.source} states {stated:.3f}, the samples give {solution.correlation[i, j]:.3f}"
                findings.append({"code": "correlation", "subject": f"{one}, {other}", "text": text})


def _verdict(claim, result, decided, findings):
    """Compare the decisions of a claim on single values, and its verdict."""
    for (name, kind), stated in claim.decisions.items():
        kinds = [kind] if kind else ["within", "sigma_below"]
        own = [decided[name, k] for k in kinds if (name, k) in decided]
        if own and not any(near for _, near in own) and all(passed for passed, _ in own) != stated:
            text = f"{claim.source} states {_word(stated)} ({kind or 'limits'}), the samples do not"
            findings.append({"code": "decision", "subject": name, "text": text})
    failed = [f"{name} {kind}" for (name, kind), (passed, near) in decided.items() if not passed and not near]
    others = [check["name"] for check in result.get("checks", []) if not check["passed"]]
    if claim.verdict == "pass" and claim.result is None and result.get("partial"):
        text = f"{claim.source} states pass, but the run omitted stages of the product"
        findings.append({"code": "verdict", "subject": claim.verdict, "text": text})
    if claim.verdict == "pass" and (failed or others):
        text = f"{claim.source} states pass, but these failed: {', '.join([*failed, *others][:5])}"
        findings.append({"code": "verdict", "subject": claim.verdict, "text": text})
    if claim.verdict == "fail" and not failed and not others and not any(near for _, near in decided.values()):
        text = f"{claim.source} states fail, but every value is within its limits and no check failed"
        findings.append({"code": "verdict", "subject": claim.verdict, "text": text})


def _word(passed):
    return "pass" if passed else "fail"


def show(report):
    """Print the comparison as a table."""
    print(f"{'parameter':<20}{'stated':>15}{'own':>15}{'sigma':>12}{'difference':>12}{'sigma ratio':>13}")
    for name, row in report["parameters"].items():
        (value, _), (own, sigma) = row["stated"], row["own"]
        print(
            f"{name:<20}{value:>15.6e}{own:>15.6e}{sigma:>12.2e}{row['difference']:>+12.4f}{row['sigma_ratio']:>13.4f}"
        )
    for finding in report["findings"]:
        print(f"{finding['code']}: {finding['subject']}: {_printable(finding['text'])}")
    verdict = report["verdict"]
    print(f"log {report['log']['log']}")
    print(f"verdict stated: {verdict['stated']}; limits by own values: {verdict['limits']}")
    print("The log agrees." if report["agrees"] else f"The log does not agree: {len(report['findings'])} findings.")


def _printable(text):
    return "".join(c if c.isprintable() else "?" for c in text)


def main(arguments: list[str] | None = None) -> int:
    """Run the program; return 0 if everything agrees, 1 if not, 2 if a file cannot be read or is not covered."""
    parser = argparse.ArgumentParser(
        prog="verify", description="Solve a log independently and compare its certificate."
    )
    parser.add_argument("source", metavar="CERTIFICATE.pdf|DCC.xml|RESULT.json|LOG.h5")
    parser.add_argument("--log", metavar="LOG.h5", help="log of the certificate, if it is not beside it")
    parser.add_argument("--json", metavar="FILE|-", help="write the comparison as JSON")
    options = parser.parse_args(arguments)
    try:
        report = verify(options.source, options.log)
        if options.json and options.json != "-":
            Path(options.json).write_text(json.dumps(report, indent=1), encoding="utf-8")
    except (UnreadableError, NotCoveredError, OSError, LookupError, TypeError, ValueError, AttributeError) as exc:
        reason = f"This program does not cover {exc}." if isinstance(exc, NotCoveredError) else str(exc)
        if not isinstance(exc, (UnreadableError, NotCoveredError, OSError)):
            reason = f"{options.source} has an entry of another kind than expected: {exc!r}"
        print(f"verify: {_printable(reason)}", file=sys.stderr)
        return 2
    if options.json == "-":
        print(json.dumps(report, indent=1))
    else:
        show(report)
    return 0 if report["agrees"] else 1
