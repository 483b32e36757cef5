from .design import STAGE as STAGE
from .design import Design as Design
from .design import DesignRequest as DesignRequest
from .design import Variation as Variation
from .designer import design_schedule as design_schedule
