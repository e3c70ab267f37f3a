"""``python -m nvdb.replay``: serve recorded or generated pages on loopback."""

import sys

from nvdb.replay.server import main

sys.exit(main())
