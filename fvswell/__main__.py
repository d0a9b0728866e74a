"""``python -m fvswell``: the command line."""

from fvswell.cli.main import main

main()
