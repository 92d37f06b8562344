"""`python -m eimi_lab` is the command `eimi`."""

from eimi_lab.cli import main

main()
