"""`python -m calstation.verify`, or `python -m verify` beside a copy of this folder."""

from . import main

raise SystemExit(main())
