"""``python -m skinrig``: the command line, where no command of that name is on the path."""

from acquire.cli import main

main()
