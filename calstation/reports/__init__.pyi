from .label import label_template as label_template
from .label import print_label as print_label
