"""``python -m pcsg``."""

from pcsg.cli import main

main()
