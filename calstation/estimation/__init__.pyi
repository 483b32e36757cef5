from .method import Estimate as Estimate
from .method import Innovations as Innovations
from .method import Method as Method
from .method import Progress as Progress
from .method import RepeatedSchedule as RepeatedSchedule
from .method import Solution as Solution
from .method import StageSolver as StageSolver
from .method import batch_method as batch_method
