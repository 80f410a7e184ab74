"""`python -m cortet.cli`."""

import sys

from cortet.cli import main

sys.exit(main())
