"""Check standards of a station: due dates of their runs, and refusal of production while one is overdue or failed."""

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Literal

from calstation.config import CheckStandardSection, ProductConfig, RunConfiguration, StationConfig, library
from calstation.devices.profiles import ImuProfile, load_imu_profile
from calstation.errors import ConfigurationError, InputError
from calstation.estimation.common import Posterior
from calstation.judgement import StandardComparison, judge_standard
from calstation.messages import Text
from calstation.physics import INDEX, parameter_vector
from calstation.records import InstrumentSection, OverriddenSection, RunFilter, RunRecord, Verdict, covariance_from
from calstation.results import History, Result

#: Why production is refused: no run of a check standard has passed, or the next is overdue; its last run failed a limit
#: or a check of the product, disagrees with the reference, or was altered; or a certificate is overdue.
Reason = Literal["never", "overdue", "failed", "out", "altered", "certificate"]
#: State of an instrument: its next calibration is overdue, its calibration is dated after today, it has no due date, or
#: there is no problem.
InstrumentState = Literal["overdue", "future", "undated", "good"]


@dataclass(frozen=True)
class StandardProblem:
    """A check standard or an instrument that is overdue or has failed."""

    name: str  #: Serial number of the check standard, or name of the instrument.
    reason: Reason
    #: Due time, or time of the last run if it failed or was altered; None if no run has passed.
    since: datetime | None

    @property
    def when(self) -> str:
        """`since` as text in local time, only the date for a certificate; "" for None."""
        format_ = "%Y-%m-%d" if self.reason == "certificate" else "%Y-%m-%d %H:%M"
        return "" if self.since is None else self.since.astimezone().strftime(format_)

    @property
    def section(self) -> OverriddenSection:
        """The entry in the log of a run that is permitted despite the problem."""
        utc = "" if self.since is None else f"{self.since.astimezone(UTC):%Y-%m-%d %H:%M} UTC"
        return OverriddenSection(
            reason=self.reason, name=self.name, since=self.when if self.reason == "certificate" else utc
        )

    def error(self, setup: RunConfiguration) -> ConfigurationError:
        """Return the error that refuses a run."""
        values = {"product": setup.product.name, "station": setup.station.name}
        return ConfigurationError(f"quality.standard_{self.reason}", name=self.name, since=self.when, **values)

    @property
    def cause(self) -> Text:
        """Reason for the refusal, as a part of a sentence."""
        return Text.of(f"quality.cause_{self.reason}", name=self.name, since=self.when)


@dataclass(frozen=True)
class StandardState:
    """State of a check standard at a station: its last passed run, the due time of its next run, and any problem."""

    standard: CheckStandardSection
    last_passed: datetime | None
    due: datetime | None  #: None if no run passed.
    problem: StandardProblem | None  #: None if there is no problem.


def judge_result(standard: CheckStandardSection, imu: ImuProfile, result: Result) -> StandardComparison:
    """Compare the stored result of a check standard with its current reference.

    Raises InputError if the result has no time of start.
    """
    rows = {name: row for name, row in result.parameters.items() if name in INDEX}
    sigma = parameter_vector({name: row.sigma for name, row in rows.items()})
    mean = parameter_vector({name: row.value for name, row in rows.items()})
    started = _time(result.started_utc or "")
    posterior = Posterior(mean, covariance_from(sigma, result.correlation))
    return judge_standard(standard, imu, started, posterior, rows.keys() - set(result.unobservable))


def standard_states(
    station: StationConfig, product: ProductConfig, history: History, now: datetime
) -> list[StandardState]:
    """Return the state of every check standard of a product at a station with its run `history`.

    The latest of `whole_runs` must have passed, must agree with the current reference, and must not be older than the
    standard's interval. A run whose result was altered does not show that the standard agrees.
    """
    if not product.check_standards:
        return []
    imu = load_imu_profile(library.find("imus", product.imu))
    return [_state(standard, imu, station, product, history, now) for standard in product.check_standards]


def whole_runs(
    standard: CheckStandardSection, station: StationConfig, product: ProductConfig, history: History, now: datetime
) -> list[RunRecord]:
    """Return the complete runs of a check standard at a station that passed or failed, the latest first.

    Runs without a valid start, and runs that started after `now`, are omitted, because they would hide all later ones.
    Runs of other folders are omitted, because their results are stored elsewhere. A run whose files are missing counts
    only if it failed.
    """
    run_filter = RunFilter(search=standard.serial, station=station.name, product=product.name, missing=None)
    return [run for run in history.runs(run_filter, limit=None) if _is_valid(run, standard, now)]


def instrument_state(instrument: InstrumentSection, now: datetime) -> InstrumentState:
    """Return the state of an instrument of any kind at `now`; its due date ends with that day in UTC."""
    today = now.astimezone(UTC).date()
    if instrument.due is not None and instrument.due < today:
        return "overdue"
    if instrument.calibrated is not None and instrument.calibrated > max(today, now.astimezone().date()):
        return "future"
    return "undated" if instrument.due is None else "good"


def overdue_instruments(station: StationConfig, now: datetime) -> list[StandardProblem]:
    """Return the station's instruments of any kind whose next calibration was due before the date of `now` in UTC."""
    return _overdue(station.instruments, now)


def due_certificates(station: StationConfig, now: datetime) -> list[StandardProblem]:
    """Return the overdue instruments because of which production is refused: the station's table and surveys."""
    return _overdue([each for each in station.instruments if each.required], now)


def _overdue(instruments: Iterable[InstrumentSection], now: datetime) -> list[StandardProblem]:
    return [
        StandardProblem(each.name, "certificate", datetime.combine(each.due, datetime.min.time()).astimezone())
        for each in instruments
        if each.due is not None and instrument_state(each, now) == "overdue"
    ]


def require_standards(setup: RunConfiguration, history: History, now: datetime) -> list[StandardProblem]:
    """Refuse a production run while a check standard or a certificate is overdue or failed.

    A run of a check standard is always permitted. Returns the problems despite which an override in the request permits
    the run, or [].

    Raises
    ------
    ConfigurationError : if there is a problem and the request has no override, or an override without a reason.
    """
    reason = setup.request.override_standard
    if reason is not None and not reason.strip():
        raise ConfigurationError("quality.no_reason")
    if setup.check_standard is not None:
        return []
    states = standard_states(setup.station, setup.product, history, now)
    problems = [state.problem for state in states if state.problem is not None] + due_certificates(setup.station, now)
    if problems and reason is None:
        if len(problems) == 1:
            raise problems[0].error(setup)
        values = {"product": setup.product.name, "station": setup.station.name}
        raise ConfigurationError("quality.not_in_order", causes=[problem.cause for problem in problems], **values)
    return problems


def _state(
    standard: CheckStandardSection,
    imu: ImuProfile,
    station: StationConfig,
    product: ProductConfig,
    history: History,
    now: datetime,
) -> StandardState:
    runs = whole_runs(standard, station, product, history, now)
    last = next(iter(runs), None)
    passed = next((run for run in runs if run.verdict is Verdict.PASSED and _agrees(run, standard, imu, history)), None)
    last_passed = None if passed is None else _time(passed.started_utc)
    due = None if last_passed is None else last_passed + timedelta(days=standard.interval_days)
    problem = None
    if last is not None and last != passed:
        agrees = _agrees(last, standard, imu, history)
        reason: Reason = "out" if agrees is False else "altered" if last.verdict.passed else "failed"
        problem = StandardProblem(standard.serial, reason, _time(last.started_utc))
    elif due is None:
        problem = StandardProblem(standard.serial, "never", None)
    elif due < now:
        problem = StandardProblem(standard.serial, "overdue", due)
    return StandardState(standard, last_passed, due, problem)


def _is_valid(run: RunRecord, standard: CheckStandardSection, now: datetime) -> bool:
    judged = run.serial == standard.serial and not run.origin and not run.partial and run.verdict.judged
    judged = judged and not (run.missing and run.verdict.passed)
    try:
        return judged and _time(run.started_utc) <= now
    except InputError:
        return False


def _agrees(run: RunRecord, standard: CheckStandardSection, imu: ImuProfile, history: History) -> bool | None:
    """Return whether the result of a run agrees with the reference; None if it cannot be read or was altered."""
    try:
        return judge_result(standard, imu, history.result(run)).passed
    except InputError:
        return None


def _time(text: str) -> datetime:
    try:
        return datetime.fromisoformat(text).astimezone(UTC)
    except (ValueError, OverflowError) as exc:
        raise InputError("quality.no_start", text=text) from exc
