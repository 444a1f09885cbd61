"""`python -m deltaph`."""

from deltaph.cli import main

main()
