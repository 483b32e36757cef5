"""`python -m calstation.verify`, or `python -m verify` beside a copy of this folder."""

import sys

from . import main

sys.exit(main())
