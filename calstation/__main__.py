"""`python -m calstation` is the `calstation` command."""

from calstation.cli import main

main()
