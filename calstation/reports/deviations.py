"""Deviations of a run from its method, and other notes for readers of the certificate."""

from collections.abc import Iterator, Sequence
from datetime import date

from calstation.errors import CalstationError
from calstation.judgement import short_names
from calstation.messages import Text
from calstation.parsing import parse_toml
from calstation.records import CheckKind, InstrumentSection
from calstation.reports.analysis import Analysis
from calstation.reports.budget import LATITUDE_ERROR_DEG
from calstation.reports.content import Certificate
from calstation.results import Result
from procedures import DEFAULT_STAGES, method

#: Checks that fail if effects outside the error model affect the values.
_EFFECT_CHECKS: tuple[CheckKind, ...] = ("effects", "halves", "agreement", "consistency", "convergence", "clipping")
#: Maximum number of names listed in a deviation; only the number of further names is stated.
_MAX_NAMES = 8


def deviations(certificate: Certificate, analysis: Analysis) -> Iterator[Text]:
    """Yield the deviations, the most important first."""
    result = certificate.result
    if certificate.meta.is_simulated:
        yield Text("certificate.d_simulated")
    yield from _end_deviations(result)
    if certificate.rewritten is not None:
        yield Text.of("certificate.d_rewritten", time=certificate.rewritten[:16].replace("T", " "))
    yield from _value_deviations(certificate)
    yield from _data_deviations(result, analysis)
    yield from _traceability_gaps(certificate, analysis.identified.get("table_serial", ""))
    yield from analysis.warnings


def not_included(certificate: Certificate, analysis: Analysis) -> Iterator[Text]:
    """Yield the effects that the stated uncertainties do not include."""
    result, temperature = certificate.result, certificate.temperature
    if result.temperature is not None:
        low, high = result.temperature.range_c
        yield Text.of("certificate.n_over_temperature", low=low, high=high)
    elif temperature is None:
        yield Text("certificate.n_temperature_unknown")
    else:
        yield Text.of("certificate.n_temperature", low=temperature.min, high=temperature.max)
    yield Text("certificate.n_stability" if certificate.meta.turn_on_sigmas else "certificate.n_stability_unknown")
    failed = [check for check in result.failed_checks if check.kind in _EFFECT_CHECKS]
    is_tested = analysis.effects_tested or any(check.kind == "effects" for check in result.checks)
    effects = "failed" if failed else "tested" if is_tested else "untested"
    yield Text(f"certificate.n_effects_{effects}")
    surveyed = certificate.meta.site.gravity_mps2 is not None
    yield Text.of(f"certificate.n_latitude{'' if surveyed else '_gravity'}", error=LATITUDE_ERROR_DEG)
    clock = [check for check in result.checks if check.kind == "sample_clock"]
    if not clock:
        yield Text("certificate.n_clock")
    else:
        worst = max(clock, key=lambda check: check.value)
        limit = worst.limit if isinstance(worst.limit, float) else worst.limit[1]
        yield Text.of("certificate.n_clock_tested", found=1e6 * worst.value, limit=1e6 * limit)


def release(result: Result) -> Iterator[Text]:
    """Yield who released a unit that failed, when and why."""
    if (override := result.override) is not None:
        people = ", ".join(filter(None, (override.by, override.confirmed_by)))
        yield Text.of("certificate.d_released", by=people, date=override.utc[:10], why=override.why)


def _end_deviations(result: Result) -> Iterator[Text]:
    fault: CalstationError | None = result.fault
    if fault is not None or result.error is not None:
        yield Text.of("certificate.d_fault", reason=result.error if fault is None else fault.as_text)
    elif result.stop_reason is not None:
        yield Text.of("certificate.d_stopped", reason=result.stop_reason)
    if result.outcome == "resolved":
        software = result.software.version if result.software is not None else "–"
        span = {"first": result.log.first_seq, "last": result.log.last_seq}
        yield Text.of("certificate.d_resolved", software=software, stages=result.stages, **span)
    elif result.registers is None or result.registers.new is None:
        yield Text("certificate.d_registers_kept")
    if result.registers is not None and result.registers.new is not None and not result.registers.verified:
        yield Text("certificate.d_unverified")
    yield from release(result)
    if result.standard_override is not None:
        causes = [
            Text.of(f"quality.cause_{each.reason}", name=each.name, since=each.since)
            for each in result.standard_overridden
        ]
        by = ", ".join(result.standard_override_by)
        code = "certificate.d_standard_overridden" if causes and by else "certificate.d_standard_override"
        yield Text.of(code, by=by, causes=causes, why=result.standard_override)
    if result.resumed_from is not None:
        yield Text.of("certificate.d_resumed", log=result.resumed_from)
    if result.attempt > 1:
        yield Text.of("certificate.d_attempt", attempt=result.attempt)


def _value_deviations(certificate: Certificate) -> Iterator[Text]:
    result = certificate.result
    if result.partial:
        product = parse_toml(certificate.meta.profiles.get("product", ""))
        omitted = [stage for stage in product.get("stages", DEFAULT_STAGES) if stage not in result.stages]
        yield Text.of("certificate.d_partial", stages=omitted)
    if result.ended_by_hand:
        yield Text.of("advice.ended_by_hand", stages=result.ended_by_hand)
    if result.calibration is not None:
        calibration = result.calibration
        yield Text.of("certificate.d_calibration", date=calibration.started_utc[:10], log=calibration.log)
        if calibration.not_improved:
            yield Text.of("certificate.d_not_improved", names=_names(calibration.not_improved))
    if result.undetermined:
        yield Text.of("certificate.d_unobservable", names=_names(result.undetermined))
    not_compared = [name for name in result.not_compared if name not in result.unobservable]
    if not_compared:
        yield Text.of("certificate.d_not_compared", names=_names(not_compared))
    for stage, reason in result.missing_data.items():
        yield Text.of("certificate.d_missing_data", stage=stage, reason=reason)
    if result.states_added:
        yield Text.of("certificate.d_states", names=[Text(f"group.{name}") for name in result.states_added])
    failed = result.failed_checks
    for check, name in zip(failed, short_names(failed), strict=True):
        cause = check.cause_text
        if cause is not None:
            yield Text.of("certificate.d_cause", check=name, cause=cause)
    near_misses = [check.subject for check in result.checks if check.near_miss and check.subject in result.parameters]
    if near_misses:
        yield Text.of("certificate.d_near", names=_names(list(dict.fromkeys(near_misses))))


def _data_deviations(result: Result, analysis: Analysis) -> Iterator[Text]:
    for stage, consistency in result.consistency.items():
        if consistency.warning:
            yield Text.of("certificate.d_warning", stage=stage, value=consistency.nis_mean, low=consistency.nis_low)
    if result.log.gaps:
        yield Text.of("certificate.d_gaps", count=result.log.gaps)
    if result.log.damaged:
        yield Text.of("certificate.d_damaged", count=sum(part.rows for part in result.log.damaged))
    if analysis.invalid:
        yield Text.of("certificate.d_invalid", count=analysis.invalid)


def _traceability_gaps(certificate: Certificate, reported: str) -> Iterator[Text]:
    """Yield gaps in the traceability; `reported` is the serial number reported by the table, or ""."""
    day = certificate.days[0]
    for instrument in certificate.instruments:
        if instrument.due is not None and instrument.due < day:
            yield Text.of("certificate.d_overdue", name=instrument.name, due=instrument.due.isoformat())
        if _is_later(instrument, day):
            yield Text.of("certificate.d_calibrated_later", name=instrument.name, date=str(instrument.calibrated))
    with_table = [stage for stage in certificate.result.stages if not method(stage).needs_no_table]
    tables = [
        i for i in certificate.instruments if i.kind == "table" and i.certificate is not None and not _is_later(i, day)
    ]
    if with_table and not tables:
        yield Text("certificate.d_no_table")
    declared = [i.serial for i in certificate.instruments if i.kind == "table" and i.serial is not None]
    if with_table and reported and declared and not {reported, *reported.split(" + ")} & {*declared}:
        yield Text.of("certificate.d_other_table", reported=reported, declared=", ".join(declared))


def _is_later(instrument: InstrumentSection, day: date) -> bool:
    """Return whether an instrument was calibrated after `day`, so that its certificate was not valid yet."""
    return instrument.calibrated is not None and instrument.calibrated > day


def _names(names: Sequence[str]) -> list[Text | str]:
    """Return a list of parameters for a sentence, with the number of further parameters."""
    listed: list[Text | str] = [Text.of("certificate.parameter", name=name) for name in names[:_MAX_NAMES]]
    if len(names) > _MAX_NAMES:
        listed.append(Text.of("certificate.more", count=len(names) - _MAX_NAMES))
    return listed
