from .config import BenchConfig as BenchConfig
from .config import BenchReport as BenchReport
from .config import Order as Order
from .config import OrderName as OrderName
