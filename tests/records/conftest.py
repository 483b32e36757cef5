"""Fixtures of the records tests."""

import pytest
from records_samples import META, make_block

from calstation.estimation.common import SampleBlock
from calstation.records import LogMeta


@pytest.fixture
def meta() -> LogMeta:
    return LogMeta.model_validate(META)


@pytest.fixture
def blocks() -> list[SampleBlock]:
    return [
        make_block("", 0, 70),
        make_block("rate", 70, 3000, step=1),
        make_block("rate", 3075, 500, step=2),
        make_block("", 3575, 10, step=2),
        make_block("excitation", 3585, 800, step=3),
    ]
