"""``python -m kfgen``."""

from kfgen.cli import main

main()
