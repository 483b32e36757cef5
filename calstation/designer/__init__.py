"""Search for the shortest schedule of the method `designed` or over temperature, and analysis of undetected effects.

The sigmas are computed with the plan and the filter of a run; no table is moved.
"""

from calstation.designer.design import STAGE, Design, DesignRequest, Variation, designed_product, save_product
from calstation.designer.designer import design_schedule
from calstation.designer.prediction import Prediction
from calstation.designer.soaking import measured_thermal
from calstation.designer.stages import ShorterStages, shorten_stages, shorter_product
from calstation.designer.temperature import (
    TIME_CONSTANT,
    TemperatureDesign,
    design_temperature,
    temperature_product,
    unit_properties,
)
