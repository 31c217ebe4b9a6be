"""``python -m examples.telescope_focus DIR``."""

import sys

from .command import main

sys.exit(main())
