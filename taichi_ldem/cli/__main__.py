"""``python -m taichi_ldem.cli``."""

import sys

from taichi_ldem.cli import main

sys.exit(main())
