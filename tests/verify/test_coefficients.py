"""The second opinion and calstation fit the same coefficients and hysteresis to the same equations of points."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calstation.estimation.common import Posterior, TemperatureModel
from calstation.estimation.temperature import TemperaturePoint, fit_temperature, held_out_points, with_ways
from calstation.physics import COUNT, INDEX, NAMES, PARAMETERS
from calstation.verify import samples, temperature
from calstation.verify.estimate import Joint

SIGMA = np.array([p.prior_sigma for p in PARAMETERS])
ORDER = {"gyro_bias": 2, "gyro_scale": 1, "accel_bias": 2}
TEMPERATURES, HELD_OUT = (25.0, -40.0, -10.0, 25.0, 55.0, 85.0, 40.0, 10.0, 60.0), 55.0
DRIFT, LENGTH = 1e-4, 3000


def test_both_programs_fit_the_same_coefficients(monkeypatch: pytest.MonkeyPatch) -> None:
    rng, model = np.random.default_rng(5), TemperatureModel(25.0, (-40.0, 85.0), ORDER, held_out=(HELD_OUT,))
    scaled = np.array([0.3 * SIGMA[column.parameter] * rng.normal() for column in model.columns])
    prior, loop = Posterior(np.zeros(COUNT), np.diag(SIGMA**2)), np.zeros(COUNT)
    loop[INDEX["gyro_bias_y"]] = 0.01 * SIGMA[INDEX["gyro_bias_y"]]
    order, data, points = [NAMES.index(name) for name in samples.NAMES[:COUNT]], [], []
    for k, t in enumerate(TEMPERATURES):
        H = 100.0 * rng.normal(size=(60, COUNT)) / SIGMA
        truth = model.basis(t) @ scaled + loop * np.sign(t - TEMPERATURES[max(k - 1, 0)])
        data.append((H, H @ truth + rng.normal(size=60)))
        covariance = np.linalg.inv(np.diag(SIGMA**-2.0) + H.T @ H)
        solved, seq = Posterior(covariance @ H.T @ data[k][1], covariance), k * 2 * LENGTH
        points.append(TemperaturePoint(t, 0.0, 600.0 * k, "soak", seq, seq + LENGTH - 1, prior, solved))
    points = held_out_points(with_ways(points), model.held_out)
    instability = np.zeros(COUNT)
    instability[[INDEX[f"{kind}_bias_{axis}"] for kind in ("gyro", "accel") for axis in "xyz"]] = (
        temperature.ALLAN * DRIFT
    )
    fit = fit_temperature(model, points, prior, instability=instability)

    def stages(_: Any, first: int, last: int) -> dict[str, Any]:
        seq, k = np.arange(first, last + 1), first // (2 * LENGTH)
        return {"temperature": SimpleNamespace(k=k, seq=seq, temperature=np.full(len(seq), TEMPERATURES[k]))}

    def equations(part: Any, *_: Any) -> Any:
        H, z = data[part.k]
        full = np.hstack([H[:, order], np.zeros((60, 3))])
        return lambda point, _: (np.column_stack([full, full @ point - z]), lambda change: None)

    monkeypatch.setattr(temperature, "stages_of", stages)
    monkeypatch.setattr(temperature, "motion_equations", equations)
    section = {"reference_c": model.reference, "range_c": list(model.range)}
    setting = SimpleNamespace(meta={"temperature": section}, dt=0.01, drift=np.full(6, DRIFT), velocity=1.0)
    setting.offset_sigma = np.zeros(2)
    stated: dict[str, Any] = {"coefficients": {}}
    for p in PARAMETERS:
        stated["coefficients"][p.name] = {"values": [0.0] * (ORDER.get(p.group, 0) + 1)}
    stated["points"] = [{"first_seq": p.first_seq, "last_seq": p.last_seq, "held_out": p.is_held_out} for p in points]
    before = Joint(np.zeros((COUNT + 3, 4)), np.diag(np.append(SIGMA[order], np.zeros(3)) ** 2), np.zeros((0, 4)))
    opinion = temperature.OverTemperature(SimpleNamespace(setting=setting), None, stated, before)
    mean, covariance, _ = opinion.complete(np.zeros(2), np.zeros(2), 0.0)
    own, sigma = dict(zip(opinion.names, mean[COUNT + 3 :], strict=True)), np.sqrt(np.diag(covariance))[COUNT + 3 :]
    own_sigma = dict(zip(opinion.names, sigma, strict=True))
    assert fit.hysteresis[INDEX["gyro_bias_y"]] > 0.3 * loop.max()
    for column, value, variance in zip(model.columns, fit.coefficients, np.diag(fit.covariance), strict=True):
        name = f"{NAMES[column.parameter]}[{column.power}]"
        assert own_sigma[name] == pytest.approx(np.sqrt(variance), rel=1e-4), name
        assert own[name] == pytest.approx(value, abs=1e-3 * np.sqrt(variance)), name
