"""``python -m vip_factors``: the same as ``vip-factors``."""

import sys

from vip_factors.cli.main import main

sys.exit(main())
