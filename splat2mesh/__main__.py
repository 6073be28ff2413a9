"""`python -m splat2mesh`: the command."""

import sys

from .cli import main

sys.exit(main())
