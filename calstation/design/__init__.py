"""Schedules of the method `designed`: search for the shortest one, and analysis of the effects that it detects.

Sigmas come from the run's own plan and filter; no code in this package drives a table.
"""

from calstation.design.design import STAGE, Design, DesignRequest, Variation, designed_product, save_design
from calstation.design.designer import design_schedule
from calstation.design.stages import ShorterStages, shorten_stages, shorter_product
