"""Judgement of a unit: `judge` compares the solutions with the limits; `verdict_of` returns the verdict of a run.

The tests of data and model are run while the stages are solved, and are stored in the solutions. The limits are entries
of files and logs; see `calstation.records.product`.
"""

from calstation.judgement.acceptance import offline_online
from calstation.judgement.check import Check, Where, short_names
from calstation.judgement.conformity import Conformity, ParameterConformity
from calstation.judgement.data_tests import DataTests, TestedSamples, data_faults
from calstation.judgement.judge import (
    End,
    Judgement,
    SolvedAgain,
    advice,
    compare_only,
    is_partial,
    judge,
    needs_full_calibration,
    remedy_of,
    verdict_of,
)
from calstation.judgement.limits import (
    COVERAGE_FACTOR,
    acceptance_interval,
    change_sigma,
    check_limits,
    estimated_stage,
    final_checks,
    undetermined,
    unobservable,
)
from calstation.judgement.model_tests import ModelTests
from calstation.judgement.site import latitude_agrees, require_latitude, unconfirmed_site
from calstation.judgement.standards import FALSE_ALARM, POWER, StandardComparison, judge_standard, reference_variances
