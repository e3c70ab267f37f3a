"""``python -m nvdb.replay``: serve recorded pages on loopback."""

import sys

from nvdb.replay.server import main

sys.exit(main())
