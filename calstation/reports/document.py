"""The data for the template of a certificate: texts in one language, rounded numbers, and the points of charts."""

import math
from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Any

import numpy as np

from calstation import __version__
from calstation.devices.profiles import ImuProfile
from calstation.judgement import COVERAGE_FACTOR, Check
from calstation.messages import (
    Language,
    Text,
    known,
    parameter_name,
    product_name,
    render,
    station_name,
    term,
)
from calstation.parsing import parse_toml
from calstation.physics import (
    DEGREE,
    INDEX,
    NAMES,
    NOISE_DISPLAY,
    display,
    display_by_unit,
    group_of,
    unit_of_parameter,
)
from calstation.records import Verdict, context_from_meta
from calstation.reports.analysis import Analysis
from calstation.reports.budget import SOURCES, Budget
from calstation.reports.charts import Charts, axis_of, capitalised, in_certificate_terms, stage_name
from calstation.reports.content import (
    Certificate,
    Quantity,
    arrangement,
    performed,
    unit_registers,
)
from calstation.reports.deviations import deviations, not_included, release
from calstation.reports.numbers import (
    NONE,
    check_unit,
    compared,
    exact,
    in_display,
    interval,
    limit_text,
    percentage,
    rounded,
    short,
)
from calstation.reports.over_temperature import statement, temperature_section
from calstation.reports.schedule import schedule_words
from calstation.results import Verification, plain
from procedures import method

#: Share below which noise estimated from the data is due to rounding and nonlinearity, and has no column.
_NEGLIGIBLE = 0.005
#: Display units of checks whose SI unit is also used by other quantities.
_UNITS = {"latitude": ("°", DEGREE), "sample_clock": ("ppm", 1e-6)}
#: Maximum number of failed checks listed in the verdict.
_MAX_NAMED = 4


def document(certificate: Certificate, analysis: Analysis, language: Language) -> dict[str, Any]:
    """Return the data for the template of a certificate."""
    built = _Document(certificate, analysis, language).sections()
    plain_data: dict[str, Any] = plain(built)
    return plain_data


class _Document:
    def __init__(self, certificate: Certificate, analysis: Analysis, language: Language) -> None:
        self._certificate, self._analysis, self._language = certificate, analysis, language
        self._result, self._meta = certificate.result, certificate.meta
        self._groups = [(g, list(rows)) for g, rows in groupby(certificate.quantities, lambda q: group_of(q.name))]

    def sections(self) -> dict[str, Any]:
        certificate, result, laboratory = self._certificate, self._result, self._certificate.laboratory
        return {
            "language": "zh" if self._language == "zh_CN" else "en",
            "number": certificate.identification,
            "supersedes": certificate.supersedes,
            "reason": certificate.reason,
            "issued": certificate.issued.isoformat(),
            "received": None if certificate.received is None else certificate.received.isoformat(),
            "verdict": certificate.verdict,
            "verdict_text": self._say(self._verdict()),
            "simulated": self._say(Text("certificate.d_simulated")) if certificate.meta.is_simulated else None,
            "notices": [self._say(text) for text in self._notices()],
            "rule": self._say(Text(f"certificate.rule_{certificate.rule}")),
            "guarded": any(quantity.acceptance is not None for quantity in certificate.quantities),
            "coverage_factor": f"{COVERAGE_FACTOR:g}",
            "laboratory": None if laboratory is None else laboratory.model_dump(),
            "unit": {
                "serial": result.serial,
                "product": None if result.product is None else product_name(result.product, self._language),
                "imu": self._interface(),
                "secondaries": [
                    {"name": term("dcc", "secondary", self._language, number=number), "serial": imu.serial}
                    for number, imu in self._meta.secondaries.items()
                ],
            },
            "performed": self._performed(),
            "operator": result.operator,
            "station": None if result.station is None else station_name(result.station, self._language),
            "groups": [self._group(*group) for group in self._groups],
            "checks": [self._check(check) for check in result.checks if check.subject not in result.parameters],
            "over": temperature_section(self._result, self._language),
            "budget": self._budget(),
            "stages": [self._stage(stage) for stage in result.stages],
            "environment": self._environment(),
            "instruments": [instrument.model_dump() for instrument in certificate.instruments],
            "identified": self._analysis.identified,
            "held_registers": self._unit_registers(),
            "authorised": list(certificate.authorised),
            "deviations": [capitalised(self._say(text)) for text in deviations(certificate, self._analysis)],
            "registers": self._registers(),
            "configuration": self._configuration(),
            "charts": Charts(self._result, self._analysis, self._groups, self._language).sections(),
        }

    def _say(self, text: Text) -> str:
        return render(text.code, text.values, self._language, window=True).sentences

    def _interface(self) -> str | None:
        """Return the protocol and the name of the unit's IMU profile; None if the log does not contain it."""
        profile = parse_toml(self._meta.profiles.get("imu", ""))
        if "name" not in profile:
            return None
        protocol = str(profile.get("protocol", ImuProfile.model_fields["protocol"].default))
        values = {"name": term("protocol", protocol, self._language), "note": str(profile["name"])}
        return render("common.noted", values, self._language).text

    def _verdict(self) -> Text:
        result, verdict = self._result, self._certificate.verdict
        if verdict is Verdict.PASSED and result.unjudged:
            return Text.of("certificate.passed_judged", names=result.unjudged)
        if verdict is Verdict.PASSED:
            return Text("certificate.passed")
        if verdict is Verdict.PARTIAL:
            return Text.of("certificate.partial", stages=result.stages)
        if verdict is Verdict.FAILED:
            failed = result.failed_checks
            if not failed and result.check_standard is not None:
                return Text("certificate.failed_standard")
            names = [self._check_text(check) for check in failed[:_MAX_NAMED]]
            between = "；" if self._language == "zh_CN" else "; "
            text = between.join(names) + (" …" if len(failed) > _MAX_NAMED else "")
            return Text.of("certificate.failed", count=len(failed), names=text)
        if not result.verdict.judged:
            return Text.of("certificate.ended", outcome=result.outcome)
        limits = self._meta.product is not None and (self._meta.product.limits or self._meta.product.checks)
        return Text("certificate.not_complete" if limits else "certificate.no_limits")

    def _notices(self) -> Iterator[Text]:
        """Yield the notices about the scope of the result for the first page."""
        if self._result.temperature is not None:
            yield statement(self._result.temperature)
        if self._result.outcome == "resolved":
            yield Text("certificate.solved_again")
        yield from release(self._result)
        if self._certificate.verdict is Verdict.FAILED and self._result.partial:
            yield Text.of("certificate.partial_failed", stages=self._result.stages)

    def _performed(self) -> dict[str, str]:
        period = performed(self._result)
        if period is None:
            return {"date": NONE, "begin": NONE, "end": NONE}
        begin, end = period
        return {"date": f"{begin:%Y-%m-%d}", "begin": f"{begin:%Y-%m-%d %H:%M}", "end": f"{end:%Y-%m-%d %H:%M}"}

    def _group(self, group: str, rows: Sequence[Quantity]) -> dict[str, Any]:
        return {
            "name": capitalised(term("group", group, self._language)),
            "unit": unit_of_parameter(rows[0].name)[0],
            "rows": [self._row(group, quantity) for quantity in rows],
        }

    def _row(self, group: str, q: Quantity) -> dict[str, Any]:
        value, sigma = display(q.name, q.value)[0], display(q.name, q.sigma)[0]
        expanded = COVERAGE_FACTOR * sigma
        size = unit_of_parameter(q.name)[1]
        return {
            "axis": axis_of(group, q.name),
            "value": compared(rounded(value, expanded), size, q.value, q.limit),
            "expanded": compared(rounded(expanded, expanded), size, q.sigma, q.sigma_limit, COVERAGE_FACTOR),
            "limit": NONE if q.limit is None else interval(*q.limit, size, q.value),
            "accepted": NONE if q.accepted is None else interval(*q.accepted, size, q.value),
            "sigma_limit": NONE if q.sigma_limit is None else limit_text(q.sigma_limit, size, q.sigma),
            "found": rounded(in_display(q.name, q.as_found), expanded),
            "left": rounded(in_display(q.name, q.as_left), expanded),
            "decision": self._decision(q),
            "risk": NONE if q.risk is None else percentage(q.risk),
        }

    def _decision(self, q: Quantity) -> str:
        if not q.unobservable or q.decision != "not_judged":
            return q.decision
        return "undetermined" if q.name in self._result.undetermined else "kept"

    def _check_text(self, check: Check) -> str:
        code, stage = check.code, check.subject
        values = {
            "parameter": parameter_name(check.subject, self._language),
            "stage": stage,
            "words": stage.replace("_", " "),
        }
        return (
            capitalised(in_certificate_terms(render(code, values, self._language, window=True).text))
            if known(code)
            else check.name
        )

    def _check(self, check: Check) -> dict[str, Any]:
        unit, size = _UNITS.get(check.kind) or check_unit(check.unit)
        if check.parameter:
            unit, size = unit_of_parameter(check.parameter)
        if check.kind == "clipping":
            unit = self._say(Text("common.samples_unit"))
        if isinstance(check.limit, tuple):
            limit = interval(*check.limit, size, check.value)
        else:
            limit = f"≤ {limit_text(check.limit, size, check.value)}"
        return {
            "text": self._check_text(check),
            "value": compared(short(check.value / size), size, check.value, check.limit),
            "limit": limit,
            "unit": unit,
            "decision": "passed" if check.passed else "failed",
        }

    def _budget(self) -> dict[str, Any] | None:
        budget = self._certificate.budget
        if budget is None:
            return None
        rows: list[dict[str, Any]] = []
        for group, quantities in self._groups:
            known_rows = [q for q in quantities if q.name in budget.variance]
            if not known_rows:
                continue
            total = [sum(budget.variance[q.name].values()) for q in known_rows]
            # mean of the shares, because in a mean of variances a poorly determined axis would hide the others
            shares = {
                source: float(
                    np.mean([budget.variance[q.name][source] / t for q, t in zip(known_rows, total, strict=True)])
                )
                for source in SOURCES
            }
            u = max(display(q.name, q.sigma)[0] for q in known_rows)
            rows.append(
                {
                    "name": capitalised(term("group", group, self._language)),
                    "unit": unit_of_parameter(known_rows[0].name)[0],
                    "shares": [max(0.0, shares[source]) for source in SOURCES],
                    "standard": rounded(u, u),
                    "expanded": rounded(COVERAGE_FACTOR * u, COVERAGE_FACTOR * u),
                }
            )
        largest = [max(row["shares"][k] for row in rows) for k in range(len(SOURCES))]
        shown = [k for k, source in enumerate(SOURCES) if source != "other" or largest[k] > _NEGLIGIBLE]
        return {
            "sources": [SOURCES[k] for k in shown],
            "rows": [{**row, "shares": [row["shares"][k] for k in shown]} for row in rows],
            "inputs": self._inputs(),
            "excluded": [self._say(text) for text in not_included(self._certificate, self._analysis)],
            "sensitivities": self._sensitivities(budget),
        }

    def _sensitivities(self, budget: Budget) -> list[dict[str, str]]:
        """Return the effects that the budget does not include, as the largest change in each group."""
        power_up, rows = self._meta.turn_on_sigmas, []
        for group, quantities in self._groups:
            names = [q.name for q in quantities]
            changes = [[known[name] for name in names if name in known] for known in (power_up, budget.latitude)]
            if not any(changes):
                continue
            change, turn_on = ([display(names[0], value)[0] for value in values] for values in reversed(changes))
            rows.append(
                {
                    "name": capitalised(term("group", group, self._language)),
                    "unit": unit_of_parameter(names[0])[0],
                    "power_up": short(float(f"{max(turn_on):.2g}")) if turn_on else NONE,
                    "latitude": short(float(f"{max(change):.2g}")) if change else NONE,
                }
            )
        return rows

    def _unit_registers(self) -> list[dict[str, str]]:
        """Return the registers of the unit before and after the run, in the order of the parameter table."""
        registers, rows = unit_registers(self._result, self._meta), []
        for name in [
            *(name for name in NAMES if name in registers),
            *(name for name in registers if name not in INDEX),
        ]:
            before, after = (exact(display(name, value)[0]) for value in registers[name])
            text, unit = capitalised(parameter_name(name, self._language)), unit_of_parameter(name)[0]
            rows.append({"name": text, "unit": unit, "before": before, "after": after})
        return rows

    def _inputs(self) -> list[tuple[str, str]]:
        """Return the names and texts of the uncertainties from which the budget was computed."""
        imu, table, site = self._meta.imu, self._meta.table, context_from_meta(self._meta).site
        rows = [(name, getattr(imu, name) / size, unit) for name, (_, unit, size) in NOISE_DISPLAY.items()]
        per_count = {"increment": ("rad", "m/s"), "rate": ("rad/s", "m/s²")}[imu.output]
        steps = (imu.gyro_quantisation, imu.gyro_lsb), (imu.accel_quantisation, imu.accel_lsb)
        for sensor, si, (quantisation, lsb) in zip(("gyro", "accel"), per_count, steps, strict=True):
            step, unit = display_by_unit(si, lsb if quantisation is None else quantisation)
            rows.append((f"{sensor}_quantisation", step, unit))
        for name in ("encoder", "mount", "base_tilt", "azimuth"):
            angle = getattr(table, f"{name}_sigma_deg")
            rows.append((name, angle, "°") if angle >= 1.0 else (name, 3600.0 * angle, "″"))
        rows.append(("velocity", 1e3 * table.velocity_sigma, "mm/s"))
        rows.append(("gravity", 1e6 * site.relative_gravity_sigma, "ppm"))
        return [(name, f"{short(value)} {unit}") for name, value, unit in rows]

    def _stage(self, stage: str) -> dict[str, Any]:
        begin, end = self._analysis.spans.get(stage, (math.nan, math.nan))
        consistency = self._result.consistency.get(stage)
        names = set(method(stage).estimates(context_from_meta(self._meta)))
        code = f"certificate.stage_{stage}"
        rounds = self._analysis.rounds.get(stage)
        tested = consistency is not None and consistency.passed is not None
        by_hand = (Text("certificate.stage_ended_by_hand"),) * (stage in self._result.ended_by_hand)
        return {
            "name": stage_name(stage, self._language),
            "text": self._say(Text(code)) if known(code) else "",
            "minutes": rounded((end - begin) / 60.0, 0.11) if math.isfinite(end) else NONE,
            "estimates": str(len(names | {q.name for q in self._certificate.quantities if q.stage == stage})),
            "nis": f"{consistency.nis_mean:.2f}" if consistency is not None and tested else NONE,
            "band": f"{consistency.nis_low:.2f} … {consistency.nis_high:.2f}"
            if consistency is not None and tested
            else NONE,
            "schedule": [
                in_certificate_terms(entry)
                for entry in (
                    *schedule_words(stage, self._meta.schedule.get(stage, {}), self._language, rounds),
                    *map(self._say, by_hand),
                )
            ],
        }

    def _environment(self) -> dict[str, Any]:
        site, temperature = context_from_meta(self._meta).site, self._certificate.temperature
        gravity_sigma = site.relative_gravity_sigma * site.local_gravity
        return {
            "temperature": None
            if temperature is None
            else {"mean": f"{temperature.mean:.1f}", "range": [f"{temperature.min:.1f}", f"{temperature.max:.1f}"]},
            "arrangement": [self._say(text) for text in arrangement(self._meta)],
            "latitude": f"{self._meta.site.latitude_deg:.4f}",
            "longitude": f"{self._meta.site.longitude_deg:.4f}",
            "height": f"{self._meta.site.height_m:.0f}",
            "azimuth": None if site.azimuth is None else f"{np.rad2deg(site.azimuth):.3f}",
            "gravity": rounded(site.local_gravity, 2.0 * gravity_sigma),
            "gravity_expanded": rounded(2.0 * gravity_sigma, 2.0 * gravity_sigma),
            "gravity_source": "computed" if site.gravity is None else "surveyed",
            "gravity_report": None if site.gravity is None else self._meta.site.gravity_source,
        }

    def _registers(self) -> dict[str, Any] | None:
        registers = self._result.registers
        if registers is None or registers.new is None:
            return None
        rows = []
        by_name: dict[str, list[Verification]] = {}
        for row in registers.proof:
            by_name.setdefault(row.name, []).append(row)
        for checks in by_name.values():
            row = max(checks, key=lambda row: abs(row.value - row.expected) / row.tolerance)
            unit, size = check_unit(row.unit)
            rows.append(
                {
                    "text": capitalised(term("verification_check", row.name, self._language)),
                    "value": short(row.value / size),
                    "expected": short(row.expected / size),
                    "tolerance": short(row.tolerance / size),
                    "unit": unit,
                    "decision": "passed" if all(row.passed for row in checks) else "failed",
                    "count": len(checks),
                }
            )
        written = registers.written_utc
        return {
            "count": len(registers.new),
            "verified": registers.verified,
            "basis": registers.proved_on or "",
            "written": "" if written is None else written[:16].replace("T", " "),
            "rows": rows,
        }

    def _configuration(self) -> dict[str, Any]:
        result, trail = self._result, self._certificate.trail
        return {
            "files": [
                {"kind": kind, "name": file.name, "version": file.version, "sha256": file.sha256}
                for kind, file in result.configuration.items()
            ],
            "configuration_sha256": result.configuration_sha256,
            "log": self._certificate.number,
            "log_sha256": result.log.sha256,
            "trail": None
            if trail is None
            else {"text": str(trail), "lines": str(trail.lines), "digest": trail.digest, "key": trail.key or NONE},
            "range": f"{result.log.first_seq} … {result.log.last_seq}",
            "solved_with": result.software.version if result.software is not None else NONE,
            "written_with": __version__,
        }
