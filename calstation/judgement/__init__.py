"""All that decides about a unit: limits, tests of data and model, acceptance, conformity, site and check standards.

The limits themselves are entries of files and logs, see `calstation.records.product`.
"""

from calstation.judgement.acceptance import acceptance, offline_online
from calstation.judgement.check import Check, Where
from calstation.judgement.conformity import Conformity, ParameterConformity, conformity
from calstation.judgement.data_tests import DataTests
from calstation.judgement.judge import Judgement, compare_only, is_partial, judge
from calstation.judgement.limits import (
    COVERAGE_FACTOR,
    acceptance_interval,
    check_limits,
    estimated_stage,
    undetermined,
    unobservable,
)
from calstation.judgement.model_tests import ModelTests
from calstation.judgement.site import (
    check_seen_latitude,
    latitude_agrees,
    unconfirmed_latitude,
    unconfirmed_site,
)
from calstation.judgement.standards import FALSE_ALARM, POWER, StandardComparison, judge_standard, reference_variances
