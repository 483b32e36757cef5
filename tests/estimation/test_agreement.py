"""The change of the posterior by a stage is consistent with its covariance."""

import numpy as np
import pytest

from calstation.estimation.common import Posterior, stage_agreement
from calstation.physics import COUNT, INDEX, PARAMETERS

NAMES = [p.name for p in PARAMETERS if p.group in ("gyro_bias", "accel_scale")]


def updated(before: Posterior, observed: np.ndarray, H: np.ndarray, sigma: float) -> Posterior:
    """Return the posterior of a linear observation with white noise."""
    S = H @ before.covariance @ H.T + sigma**2 * np.eye(len(H))
    K = before.covariance @ H.T @ np.linalg.inv(S)
    return Posterior(before.mean + K @ (observed - H @ before.mean), before.covariance - K @ H @ before.covariance)


def two_stages(random: np.random.Generator, change: float = 0.0) -> tuple[Posterior, Posterior]:
    """Return the posteriors after one and two stages; `gyro_bias_y` changes between them by `change` sigmas."""
    scale = np.array([p.prior_sigma for p in PARAMETERS])
    truth = scale * random.normal(size=COUNT)
    posterior = Posterior(np.zeros(COUNT), np.diag(scale**2))
    posteriors = []
    for _ in range(2):
        H = random.normal(size=(60, COUNT)) / scale
        posterior = updated(posterior, H @ truth + 1e-3 * random.normal(size=60), H, 1e-3)
        posteriors.append(posterior)
        truth[INDEX["gyro_bias_y"]] += change * posterior.sigma[INDEX["gyro_bias_y"]]
    return posteriors[0], posteriors[1]


def test_probabilities_of_consistent_stages_are_uniform() -> None:
    random = np.random.default_rng(1)
    agreement = [stage_agreement(*two_stages(random), NAMES[:3]) for _ in range(400)]
    assert all(f is not None and f.group == "gyro_bias" for f in agreement)
    shares = np.histogram([f.probability for f in agreement if f], bins=4, range=(0.0, 1.0))[0] / 400
    np.testing.assert_allclose(shares, 0.25, atol=5.0 * np.sqrt(0.25 * 0.75 / 400))


def test_changed_parameter_group_is_reported() -> None:
    agreement = stage_agreement(*two_stages(np.random.default_rng(2), change=10.0), NAMES)
    assert agreement is not None
    assert (agreement.group, agreement.probability < 1e-6) == ("gyro_bias", True)
    assert max(agreement.parameter_shift, key=lambda name: abs(agreement.parameter_shift[name])) == "gyro_bias_y"
    assert agreement.parameter_shift["gyro_bias_y"] == pytest.approx(7.0, abs=3.5)


def test_stage_without_information_is_not_compared() -> None:
    before, _ = two_stages(np.random.default_rng(3))
    assert stage_agreement(before, before, NAMES) is None
