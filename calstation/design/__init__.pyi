from .design import STAGE as STAGE
from .design import Design as Design
from .design import DesignRequest as DesignRequest
from .design import Variation as Variation
from .designer import design_schedule as design_schedule
from .product import designed_product as designed_product
from .product import save_design as save_design
