"""Configuration of a log, which contains everything that the solvers need in addition to the samples.

It is stored next to a CSV as TOML or inside a raw log, and includes the last cross-calibration of each pair of IMUs.
"""

import json
import tomllib
from collections.abc import Mapping
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tomli_w
from pydantic import Field, JsonValue, field_validator, model_validator

from calstation.errors import ConfigurationError, InputError
from calstation.escaping import for_file_name
from calstation.estimation.common import (
    ImuModel,
    Posterior,
    Secondary,
    Site,
    SolveContext,
    StoredCrossCalibration,
    TableModel,
)
from calstation.messages import os_reason
from calstation.parsing import parse_json, parse_toml
from calstation.physics import (
    AXIS_OFFSET_SIGMA,
    COUNT,
    DEFAULT_ORIENTATION,
    INDEX,
    NAMES,
    ORIENTATIONS,
    PAIR_PARAMETERS,
    PARAMETERS,
    EffectName,
    FloatArray,
    entry_of,
    further_parameter,
    group_indices,
    orientation_matrix,
)
from calstation.records.files import write_atomic
from calstation.records.laboratory import InstrumentSection, LaboratorySection
from calstation.records.product import ChecksSection, ConformitySection, Limit, TemperatureSection, check_limit_names
from calstation.schema import EntryError, StrictModel, check_names, load, validate

_UNIT_TOLERANCE = 1e-3
#: Largest magnitude of a negative eigenvalue of a correlation matrix that may be due to rounding.
_ROUNDING = 1e-9
#: Numbers that secondary IMUs may have in files.
FURTHER_IMUS = tuple(range(2, 10))


class SiteSection(StrictModel):
    """`[site]`: location of the table."""

    latitude_deg: float = Field(ge=-90, le=90)
    longitude_deg: float = Field(ge=-180, le=360)
    height_m: float = Field(ge=-1000, le=10000)
    azimuth_deg: float | None = Field(default=None, ge=-360, le=360)
    gravity_mps2: float | None = Field(default=None, ge=9.7, le=9.9)
    #: Standard deviation of gravity; by default 1e-6 if gravity is given and 5e-4 if it is computed.
    gravity_sigma_mps2: float | None = Field(default=None, gt=0, le=0.1)
    #: Who surveyed gravity, and in which report; None if it is not stated.
    gravity_source: str | None = Field(
        default=None, min_length=1, max_length=200, exclude_if=lambda source: source is None
    )


class ImuSection(StrictModel):
    """`[imu]`: output format and noise, in the units of `estimation.common.context.ImuModel`."""

    serial: str = Field(min_length=1)
    sample_rate_hz: float = Field(gt=0, le=100_000)
    output: Literal["increment", "rate"]
    gyro_lsb: float = Field(gt=0)
    accel_lsb: float = Field(gt=0)
    gyro_arw: float = Field(gt=0)
    accel_vrw: float = Field(gt=0)
    gyro_bias_instability: float = Field(default=0.0, ge=0)
    accel_bias_instability: float = Field(default=0.0, ge=0)
    gyro_quantisation: float | None = Field(default=None, ge=0)  #: None for one count.
    accel_quantisation: float | None = Field(default=None, ge=0)  #: None for one count.
    bandwidth_hz: float | None = Field(default=None, gt=0, exclude_if=lambda bandwidth: bandwidth is None)
    coning_compensated: bool = Field(default=False, exclude_if=lambda compensated: not compensated)


class StoredPairSection(StrictModel):
    """`[imuN.stored]`: the last cross-calibration, as in `estimation.common.context.StoredCrossCalibration`."""

    values: dict[str, float] = Field(default_factory=dict)
    gyro_static: float | None = Field(default=None, ge=0)
    accel_static: float | None = Field(default=None, ge=0)

    @field_validator("values")
    @classmethod
    def _check_values(cls, values: dict[str, float]) -> dict[str, float]:
        check_names(values, tuple(p.name for p in PAIR_PARAMETERS))
        return values


class SecondaryImuSection(ImuSection):
    """`[imu2]` to `[imu9]`: a secondary IMU sampled in the same rows as `[imu]`."""

    stored: StoredPairSection | None = None


class TableSection(StrictModel):
    """`[table]`: axes of the table, and the accuracy of its angles and of its velocity at rest."""

    outer_axis: list[float] = Field(default=[1.0, 0.0, 0.0], min_length=3, max_length=3)
    inner_axis: list[float] = Field(default=[0.0, 0.0, 1.0], min_length=3, max_length=3)
    outer_lever: Literal["estimated", "fixed"] = "estimated"
    encoder_sigma_deg: float = Field(default=0.05, gt=0, le=90)
    mount_sigma_deg: float = Field(default=1.0, gt=0, le=180)
    azimuth_sigma_deg: float = Field(default=0.5, gt=0, le=180)
    base_tilt_sigma_deg: float = Field(default=0.2, gt=0, le=90)
    velocity_sigma: float = Field(default=1e-3, gt=0)
    velocity_interval_s: float = Field(default=0.1, gt=0)
    #: Offset of the inner axis from the outer axis, along outer × inner and along inner, and its sigma.
    axis_offset_mm: tuple[float, float] = Field(
        default=(0.0, 0.0), strict=False, exclude_if=lambda offset: not any(offset)
    )
    axis_offset_sigma_mm: float = Field(
        default=1e3 * AXIS_OFFSET_SIGMA, gt=0, le=100, exclude_if=lambda sigma: sigma == 1e3 * AXIS_OFFSET_SIGMA
    )
    #: Body axes along x and z of the platform at home; the default is not stored.
    orientation: str = Field(default=DEFAULT_ORIENTATION, exclude_if=lambda name: name == DEFAULT_ORIENTATION)

    @field_validator("orientation")
    @classmethod
    def _check_orientation(cls, name: str) -> str:
        if name not in ORIENTATIONS:
            raise EntryError("log.no_orientation", orientation=name)
        return name

    @field_validator("outer_axis", "inner_axis")
    @classmethod
    def _check_axis(cls, axis: list[float]) -> list[float]:
        length = float(np.linalg.norm(axis))
        if abs(length - 1.0) > _UNIT_TOLERANCE:
            raise EntryError("log.not_unit_vector", axis=str(axis), length=length)
        return axis

    @model_validator(mode="after")
    def _check_axes(self) -> "TableSection":
        if float(np.linalg.norm(np.cross(self.outer_axis, self.inner_axis))) < 0.5:
            raise EntryError("log.parallel_axes")
        return self


class PriorSection(StrictModel):
    """`[prior.NAME]`: value and sigma of a parameter before the calibration, SI."""

    value: float | None = None
    sigma: float | None = Field(default=None, ge=0)


class ProductSection(StrictModel):
    """`[product]`: type of the unit, limits, acceptance checks, decision rule, and target sigmas."""

    name: str
    limits: dict[str, Limit] = Field(default_factory=dict)
    targets: dict[str, float] = Field(default_factory=dict)
    checks: ChecksSection | None = None
    conformity: ConformitySection | None = None

    @field_validator("limits")
    @classmethod
    def _check_limits(cls, limits: dict[str, Limit]) -> dict[str, Limit]:
        check_limit_names(limits)
        return limits


class FileSection(StrictModel):
    """`[run.files.KIND]`: a station, product, table or IMU file that the run used."""

    name: str
    #: Number of the version saved on this computer; None for a supplied file or a file edited elsewhere.
    version: int | None = None
    sha256: str


class CalibrationSection(StrictModel):
    """`[run.calibration]`: the run whose calibration is the prior of a partial run."""

    log: str  #: File name of the log of that run.
    started_utc: str


class OverriddenSection(StrictModel):
    """An overdue or failed check standard, or an expired certificate, despite which a run was allowed."""

    reason: str  #: ``certificate`` for an instrument, or else the state of the check standard.
    name: str  #: Serial number of the check standard, or name of the instrument.
    since: str = ""  #: Due date of the certificate, or time (UTC) at which the check standard was due or failed.


class RunSection(StrictModel):
    """`[run]`: operator, station, software and time of the run; a CSV of another program has no such section."""

    stages: list[str]
    station: str | None = None
    operator: str | None = None
    seed: int | None = None
    attempt: int = Field(default=1, ge=1)
    software: str
    started_utc: str
    files: dict[str, FileSection] | None = None  #: Files by kind.
    clock_error_ppm: float | None = Field(default=None, ge=0)  #: Largest error of the station's clock.
    resumed_from: str | None = None  #: Name of the log whose completed stages were copied to the start of this log.
    #: Reason for a run despite an overdue or failed check standard or certificate; None if all were valid.
    standard_override: str | None = None
    standard_override_by: list[str] | None = None  #: Persons who allowed this run; None in logs of earlier versions.
    standard_overridden: list[OverriddenSection] | None = None  #: The check standards and certificates concerned.
    calibration: CalibrationSection | None = None  #: Source of the prior; None for the IMU profile.
    batch: str | None = None  #: Common identifier of the units that were on the table together; None for a single unit.
    slot: str | None = None  #: Name of the unit's slot on the table; None at a station with one unit.
    batch_units: list[str] | None = None  #: Serial numbers of all units of the batch, in the order of their slots.


class ModelSection(StrictModel):
    """`[model]`: effects that are estimated in addition to the 30 parameters."""

    states: list[EffectName]


class LogMeta(StrictModel):
    """All sections of the configuration of a log; `imu2` to `imu9` are numbered without gaps."""

    site: SiteSection
    imu: ImuSection
    table: TableSection = TableSection()
    model: ModelSection | None = None
    temperature: TemperatureSection | None = None
    prior: dict[str, PriorSection] = Field(default_factory=dict)
    #: Prior correlation coefficients by the names of both parameters; 0 for pairs that are not listed.
    prior_correlation: dict[str, dict[str, float]] = Field(default_factory=dict)
    product: ProductSection | None = None
    run: RunSection | None = None
    laboratory: LaboratorySection | None = None
    instruments: list[InstrumentSection] = Field(default_factory=list)
    schedule: dict[str, dict[str, JsonValue]] = Field(default_factory=dict)  #: Schedule of each stage.
    profiles: dict[str, str] = Field(default_factory=dict)  #: Texts of the station and product files, by kind.
    registers: dict[str, float] = Field(default_factory=dict)  #: Registers of the unit, SI, if they act on its output.
    simulated: bool | None = None  #: Whether a recording was simulated; for a run, `run.seed` indicates it.
    #: Pauses of an exported log: station times of start and end, s; only the start if the run was stopped in the pause.
    pauses: list[list[float]] = Field(default_factory=list)
    previous: dict[str, float] = Field(default_factory=dict)  #: Last calibration, SI, if the product's checks use it.
    imu2: SecondaryImuSection | None = None
    imu3: SecondaryImuSection | None = None
    imu4: SecondaryImuSection | None = None
    imu5: SecondaryImuSection | None = None
    imu6: SecondaryImuSection | None = None
    imu7: SecondaryImuSection | None = None
    imu8: SecondaryImuSection | None = None
    imu9: SecondaryImuSection | None = None

    @field_validator("profiles")
    @classmethod
    def _check_profiles(cls, texts: dict[str, str]) -> dict[str, str]:
        for kind, text in texts.items():
            if not _is_profile(text):
                raise EntryError("log.profile_damaged", kind, kind=kind)
        return texts

    @property
    def secondaries(self) -> dict[int, SecondaryImuSection]:
        """The secondary IMUs by number."""
        sections = {number: getattr(self, f"imu{number}") for number in FURTHER_IMUS}
        return {number: section for number, section in sections.items() if section is not None}

    @property
    def is_simulated(self) -> bool:
        """Whether the samples were generated by the virtual bench."""
        return bool(self.simulated) or (self.run is not None and self.run.seed is not None)

    @property
    def calibrated(self) -> frozenset[str]:
        """Names of the parameters whose prior is the current calibration."""
        used = self.run is not None and self.run.calibration is not None
        return frozenset(p.name for p in PARAMETERS if used and p.group != "outer_lever")

    @property
    def turn_on_sigmas(self) -> dict[str, float]:
        """Known standard deviations, SI, of the changes of parameters from one power-up to the next.

        They are stated in `[stability]` of the IMU profile in the log.
        """
        stability = parse_toml(self.profiles.get("imu", "")).get("stability", {})
        rows = stability.items() if isinstance(stability, dict) else ()
        stated = {
            name: float(row["power_up"])
            for name, row in rows
            if isinstance(row, dict) and isinstance(row.get("power_up"), int | float)
        }
        sigmas = {name: entry_of(stated, name) for name in NAMES}
        return {name: sigma for name, sigma in sigmas.items() if sigma is not None}

    @model_validator(mode="after")
    def _check_secondaries(self) -> "LogMeta":
        for expected, (number, section) in enumerate(self.secondaries.items(), 2):
            if number != expected:
                raise EntryError("log.imu_numbers", number=number, missing=expected)
            rate, primary = section.sample_rate_hz, self.imu.sample_rate_hz
            if rate != primary:
                raise EntryError("log.imu_rates", f"imu{number}", "sample_rate_hz", rate=rate, primary=primary)
        return self

    @model_validator(mode="after")
    def _check_states(self) -> "LogMeta":
        if self.temperature is not None and self.model is not None and self.model.states:
            raise EntryError("temperature.states", "model", "states", states=self.model.states)
        return self

    @field_validator("registers")
    @classmethod
    def _check_registers(cls, table: dict[str, float]) -> dict[str, float]:
        cls._check_parameters({name: value for name, value in table.items() if further_parameter(name) is None})
        return table

    @field_validator("prior", "prior_correlation", "previous")
    @classmethod
    def _check_parameters(cls, table: dict[str, Any]) -> dict[str, Any]:
        check_names(table, NAMES)
        return table

    @field_validator("prior_correlation")
    @classmethod
    def _check_correlation(cls, table: dict[str, dict[str, float]]) -> dict[str, dict[str, float]]:
        for name, row in table.items():
            check_names(row, NAMES, name)
            for other in row:
                if other == name or name in table.get(other, {}):
                    raise EntryError("log.correlation_repeated", name, other, name=name, other=other)
        if table and not np.linalg.eigvalsh(covariance_from(np.ones(COUNT), table)).min() > -_ROUNDING:
            raise EntryError("log.correlation_impossible")
        return table

    def to_json(self) -> str:
        """Return canonical JSON, which is also included in the sha256 of a log."""
        return json.dumps(self._plain(), sort_keys=True, separators=(",", ":"), ensure_ascii=False)

    def to_toml(self) -> str:
        """Return TOML from which an equal `LogMeta` can be read."""
        return tomli_w.dumps(self._plain())

    def _plain(self) -> dict[str, Any]:
        plain = _without_none(self.model_dump())
        return {key: value for key, value in plain.items() if value not in ({}, [])}


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _without_none(v) for k, v in value.items() if v is not None}
    return [_without_none(item) for item in value] if isinstance(value, list) else value


def meta_from_json(text: str, source: str | Path) -> LogMeta:
    """Read the configuration stored in a raw log. Raises InputError."""
    try:
        data = parse_json(text)
    except ValueError as exc:
        raise InputError("log.damaged_configuration", file=source, detail=str(exc)) from exc
    return validate(LogMeta, data, source, InputError)


@lru_cache(maxsize=64)
def _is_profile(text: str) -> bool:
    """Return whether a text is TOML whose entry `stages`, if there is one, is a list of names."""
    try:
        stages = parse_toml(text).get("stages", [])
    except tomllib.TOMLDecodeError:
        return False
    return isinstance(stages, list) and all(isinstance(stage, str) for stage in stages)


def context_from_meta(meta: LogMeta) -> SolveContext:
    """Return the site, IMUs and table for the solvers, SI; the result is the same for a run and for its log."""
    site = meta.site
    azimuth = None if site.azimuth_deg is None else float(np.deg2rad(site.azimuth_deg))
    latitude, longitude = float(np.deg2rad(site.latitude_deg)), float(np.deg2rad(site.longitude_deg))
    secondaries = (Secondary(n, _imu_model(s), _stored_pair(s.stored)) for n, s in meta.secondaries.items())
    return SolveContext(
        Site(latitude, longitude, site.height_m, azimuth, site.gravity_mps2, site.gravity_sigma_mps2),
        _imu_model(meta.imu),
        _table_model(meta.table),
        tuple(secondaries),
        tuple(meta.model.states) if meta.model is not None else (),
        temperature=None if meta.temperature is None else meta.temperature.model(),
    )


def _imu_model(imu: ImuSection) -> ImuModel:
    fields = imu.model_dump(exclude={"sample_rate_hz", "stored"})
    return ImuModel(sample_rate=imu.sample_rate_hz, **fields)


def _table_model(table: TableSection) -> TableModel:
    degrees = (table.encoder_sigma_deg, table.mount_sigma_deg, table.azimuth_sigma_deg, table.base_tilt_sigma_deg)
    encoder, mount, azimuth, base_tilt = (float(np.deg2rad(angle)) for angle in degrees)
    return TableModel(
        _normalised(table.outer_axis),
        _normalised(table.inner_axis),
        table.outer_lever,
        encoder,
        mount,
        azimuth,
        base_tilt,
        table.velocity_sigma,
        table.velocity_interval_s,
        orientation_matrix(table.orientation),
        (1e-3 * table.axis_offset_mm[0], 1e-3 * table.axis_offset_mm[1]),
        1e-3 * table.axis_offset_sigma_mm,
    )


def _stored_pair(stored: StoredPairSection | None) -> StoredCrossCalibration:
    return StoredCrossCalibration() if stored is None else StoredCrossCalibration(**stored.model_dump())


def _normalised(axis: list[float]) -> tuple[float, float, float]:
    unit = np.asarray(axis) / np.linalg.norm(axis)
    return float(unit[0]), float(unit[1]), float(unit[2])


def prior_from_meta(meta: LogMeta) -> Posterior:
    """Return the prior of the 30 parameters before the first stage; the default is 0 with the default sigmas."""
    mean = np.zeros(COUNT)
    sigma = np.array([p.prior_sigma for p in PARAMETERS])
    for name, prior in meta.prior.items():
        if prior.value is not None:
            mean[INDEX[name]] = prior.value
        if prior.sigma is not None:
            sigma[INDEX[name]] = prior.sigma
    if meta.table.outer_lever == "fixed":
        mean[group_indices("outer_lever")] = 0.0
        sigma[group_indices("outer_lever")] = 0.0
    return Posterior(mean, covariance_from(sigma, meta.prior_correlation))


def covariance_from(sigma: FloatArray, correlation: Mapping[str, Mapping[str, float]]) -> FloatArray:
    """Return the covariance, shape (30, 30), for standard deviations, shape (30,), and correlations by name."""
    covariance = np.diag(sigma**2)
    for name, row in correlation.items():
        i = INDEX[name]
        for other, coefficient in row.items():
            j = INDEX[other]
            covariance[i, j] = covariance[j, i] = coefficient * sigma[i] * sigma[j]
    return covariance


def correlation_of(covariance: FloatArray) -> dict[str, dict[str, float]]:
    """Return the nonzero correlation coefficients in a covariance, shape (30, 30), listing each pair once."""
    sigma = np.sqrt(np.diag(covariance))
    correlations: dict[str, dict[str, float]] = {}
    for i, name in enumerate(NAMES):
        for j, other in enumerate(NAMES[:i]):
            if covariance[i, j] != 0.0:
                coefficient = covariance[i, j] / (sigma[i] * sigma[j])
                correlations.setdefault(name, {})[other] = float(np.clip(coefficient, -1.0, 1.0))
    return correlations


def pair_path(folder: Path, primary: str, secondary: str) -> Path:
    """Return the path of the file for a pair of IMUs, which is named after both serial numbers."""
    return folder / f"{for_file_name(primary)}_{for_file_name(secondary)}.toml"


def load_pair(folder: Path, primary: str, secondary: str) -> StoredCrossCalibration:
    """Load the last cross-calibration of a pair; it is empty if there is none. Raises InputError for a damaged file."""
    path = pair_path(folder, primary, secondary)
    if not path.exists():
        return StoredCrossCalibration()
    return _stored_pair(load(StoredPairSection, path, InputError))


def store_pair(folder: Path, primary: str, secondary: str, stored: StoredCrossCalibration) -> Path:
    """Replace the stored cross-calibration of a pair. Raises ConfigurationError if it cannot be written.

    Parameters
    ----------
    folder : folder of the stored pairs
    primary, secondary : serial numbers of the IMUs
    stored : cross-calibration to store
    """
    path = pair_path(folder, primary, secondary)
    content = _without_none({**asdict(stored), "values": dict(stored.values)})
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_atomic(path, tomli_w.dumps(content))
    except OSError as exc:
        raise ConfigurationError("log.pair_not_written", file=path, reason=os_reason(exc)) from exc
    return path
