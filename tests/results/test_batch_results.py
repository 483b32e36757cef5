"""The result of a unit in a batch contains batch and slot; a single unit has no such keys."""

import numpy as np

from calstation.config import RunRequest, load_configuration
from calstation.estimation import Solution
from calstation.estimation.common import Consistency, Posterior
from calstation.judgement import judge
from calstation.physics import COUNT, NAMES
from calstation.records import LogFacts, LogMeta, Verdict, prior_from_meta
from calstation.results import Ending, Result, build_result


def built(meta: LogMeta) -> Result:
    """Return the result of a solved log with this configuration."""
    posterior = Posterior(np.zeros(COUNT), np.diag(np.full(COUNT, 1e-18)))
    output = Solution("excitation", posterior, NAMES, Consistency(1.0, 0.9, 1.1, 100))
    prior = prior_from_meta(meta)
    ending = Ending(Verdict.FAILED, "a.h5", LogFacts(0, 99, 100, 0, None, 64 * "0"))
    return build_result(meta, prior, (output,), judge(meta, prior, (output,)), ending)


def test_result_has_the_batch_and_slot_of_the_log() -> None:
    alone = load_configuration(RunRequest("SN-000001")).log_meta()
    assert not {"batch", "slot", "batch_units"} & set(LogMeta.model_validate_json(alone.to_json()).run.model_fields_set)
    assert not {"batch", "slot"} & set(built(alone).to_json())
    run = alone.run.model_copy(update={"batch": "B-7", "slot": "A1", "batch_units": ["SN-000001", "SN-000002"]})
    one_of_two = LogMeta.model_validate_json(alone.model_copy(update={"run": run}).to_json())
    assert one_of_two.run.batch_units == ["SN-000001", "SN-000002"]
    result = Result.from_json(built(one_of_two).to_json())
    assert (result.batch, result.slot) == ("B-7", "A1")
