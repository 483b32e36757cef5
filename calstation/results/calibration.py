"""Current calibration of a unit: the joint estimate of its last verified run, which is the prior of a partial run."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta

import numpy as np

from calstation.config import RunConfiguration
from calstation.errors import InputError
from calstation.estimation.common import Posterior
from calstation.physics import NAMES, FloatArray, composition, group_indices, parameter_vector
from calstation.records import CalibrationSection, LogMeta, PriorSection, correlation_of, covariance_from, open_log
from calstation.results.history import History
from calstation.results.sections import JointEstimate
from calstation.sequencer import Message

_YEAR = timedelta(days=365.25)


@dataclass(frozen=True)
class Calibration:
    """A joint estimate of a unit's parameters, SI, before registers are applied, and the run that computed it."""

    section: CalibrationSection
    posterior: Posterior
    registers: Mapping[str, float]  #: Registers that the run wrote, SI, by parameter.

    def prior(self, setup: RunConfiguration, meta: LogMeta) -> LogMeta:
        """Return `meta`, the configuration of a partial run of this unit, with the calibration as its prior.

        The covariance is increased according to the stability in the IMU profile. If the registers are applied to the
        stream, the prior contains the errors that remain after their correction. The outer lever arm depends on the
        mounting and keeps the prior in `meta`.
        """
        run = meta.run
        if run is None:
            raise ValueError("the log of a run has a run section")
        elapsed = datetime.fromisoformat(run.started_utc) - datetime.fromisoformat(self.section.started_utc)
        years = max(elapsed / _YEAR, 0.0)
        mean, covariance = self.posterior.mean, self.posterior.covariance
        covariance = covariance + np.diag(setup.imu.change_sigmas(years) ** 2)
        if setup.after_registers:
            offset, matrix = composition(meta.registers or self.registers)
            inverse = np.linalg.inv(matrix)
            mean, covariance = inverse @ (mean - offset), inverse @ covariance @ inverse.T
        lever = group_indices("outer_lever")
        covariance[lever, :] = covariance[:, lever] = 0.0
        covariance[lever, lever] = 1.0
        sigma = np.sqrt(np.diag(covariance))
        values = {
            name: PriorSection(value=float(mean[i]), sigma=float(sigma[i]))
            for i, name in enumerate(NAMES)
            if i not in lever
        }
        update = {"prior": {**meta.prior, **values}, "prior_correlation": correlation_of(covariance)}
        return meta.model_copy(update={**update, "run": run.model_copy(update={"calibration": self.section})})


def current_calibration(
    history: History, setup: RunConfiguration, registers_read: Mapping[str, float] | None
) -> tuple[Calibration | None, Message]:
    """Return the unit's latest calibration whose verified registers equal the current ones, and a message about it.

    `registers_read` are the unit's current registers by parameter, SI. With None, as in a preview, they are assumed to
    be those of the latest calibration. Without a calibration, return None and the reason.
    """
    entries, serial, imu = setup.register_map, setup.request.serial, setup.log_meta().imu
    reason = Message("prior_no_calibration", {"serial": serial})
    for record in history.passed(serial):
        try:
            result = history.result(record)
            registers = result.registers
            same_imu = open_log(record.log).meta.imu == imu  # the parameters are relative to its nominal scales
        except InputError:
            continue
        if registers is None or not registers.verified or not registers.new or registers.estimate is None:
            continue
        if not same_imu or result.temperature is not None:  # the temperature of the new run is unknown
            continue
        if registers_read is not None and entries.differing_parameters(registers.new, registers_read):
            reason = Message("prior_other_registers", {"serial": serial})
            continue
        section = CalibrationSection(log=record.log.name, started_utc=record.started_utc)
        message = Message("prior_calibration", {"log": record.log.name, "date": record.started_utc})
        return Calibration(section, from_estimate(registers.estimate), registers.new), message
    return None, reason


def estimate_of(posterior: Posterior, registers: Mapping[str, float]) -> JointEstimate:
    """Return the joint estimate of the unit's parameters before registers are applied, for the result.

    `registers` are the registers applied to the stream, SI, {} if there are none.
    """
    offset, matrix = composition(registers)
    mean, covariance = offset + matrix @ posterior.mean, matrix @ posterior.covariance @ matrix.T
    return JointEstimate(
        mean=_by_name(mean), sigma=_by_name(np.sqrt(np.diag(covariance))), correlation=correlation_of(covariance)
    )


def from_estimate(estimate: JointEstimate) -> Posterior:
    """Return the mean and covariance of a joint estimate."""
    covariance = covariance_from(parameter_vector(estimate.sigma), estimate.correlation)
    return Posterior(parameter_vector(estimate.mean), covariance)


def _by_name(values: FloatArray) -> dict[str, float]:
    return dict(zip(NAMES, values.tolist(), strict=True))
