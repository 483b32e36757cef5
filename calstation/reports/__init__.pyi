from .budget import Budget as Budget
from .content import Certificate as Certificate
from .content import Quantity as Quantity
from .content import build_certificate as build_certificate
from .content import certificate_number as certificate_number
from .dcc import write_dcc as write_dcc
from .label import label_template as label_template
from .label import print_label as print_label
