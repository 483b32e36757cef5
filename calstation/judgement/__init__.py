"""All that decides about a unit; `judge` says whether it is within its limits, `verdict_of` how its run counts.

The tests of data and model run while the stages are solved, and their findings are in the solutions. The limits
themselves are entries of files and logs, see `calstation.records.product`.
"""

from calstation.judgement.acceptance import offline_online
from calstation.judgement.check import Check, Where
from calstation.judgement.conformity import Conformity, ParameterConformity
from calstation.judgement.data_tests import DataTests
from calstation.judgement.judge import End, Judgement, SolvedAgain, advice, compare_only, is_partial, judge, verdict_of
from calstation.judgement.limits import (
    COVERAGE_FACTOR,
    acceptance_interval,
    check_limits,
    estimated_stage,
    undetermined,
    unobservable,
)
from calstation.judgement.model_tests import ModelTests
from calstation.judgement.site import check_seen_latitude, latitude_agrees, unconfirmed_site
from calstation.judgement.standards import FALSE_ALARM, POWER, StandardComparison, judge_standard, reference_variances
