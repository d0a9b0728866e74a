"""``python -m fvswell``: the command line."""

from fvswell.cli import main

main()
