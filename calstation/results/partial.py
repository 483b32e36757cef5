"""Whether a run was the whole of its product's calibration, or a part of it."""

import tomllib

from calstation.records.meta import LogMeta
from procedures import DEFAULT_STAGES


def is_part(meta: LogMeta) -> bool:
    """Whether stages of the product, as the log keeps its file, were left out of the run; a foreign log is no part."""
    text = meta.profiles.get("product")
    if meta.run is None or text is None:
        return False
    stages = tomllib.loads(text).get("stages", DEFAULT_STAGES)
    return not set(stages) <= set(meta.run.stages)
