"""``python -m nvdb.replay.skriv``: an API Skriv on loopback, over recorded pages."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from datetime import UTC, date, datetime
from pathlib import Path

from nvdb.datakatalog import SKILTPLATE, SKILTPUNKT
from nvdb.objects import Skiltpunkt, skilt_from_les_v4
from nvdb.replay.loopback import serve_until_interrupted
from nvdb.replay.pages import ReplaySource
from nvdb.replay.skriv.server import SkrivReplayServer
from nvdb.replay.skriv.world import ReplayObject, SkrivWorld


def world_from_pages(folder: Path | str) -> SkrivWorld:
    """Return the signs of recorded pages as API Skriv holds them: versions, dates and plates.

    Parameters
    ----------
    folder : Path or str
        As the replay server of API Les takes it.

    Raises
    ------
    ReplaySourceError, SchemaError
        The folder or an object in it cannot be read.
    """
    source = ReplaySource(folder)
    objects = []
    for type_id in (SKILTPUNKT, SKILTPLATE):
        for record in source.select(type_id, {}):
            skilt = skilt_from_les_v4(record.raw, type_id)
            objects.append(
                ReplayObject(
                    type_id=type_id,
                    nvdb_id=skilt.nvdb_id,
                    versjon=record.versjon,
                    startdato=date.fromisoformat(skilt.start_date or "2020-01-01"),
                    barn=list(skilt.plate_ids) if isinstance(skilt, Skiltpunkt) else [],
                )
            )
    # API Skriv tells whole milliseconds.
    return SkrivWorld(objects, now=lambda: datetime.now(UTC).replace(microsecond=0))


def main(arguments: Sequence[str] | None = None) -> int:
    """Serve until Ctrl-C."""
    options = _parser().parse_args(arguments)
    return serve_until_interrupted(
        lambda: SkrivReplayServer(
            world_from_pages(options.folder), users={options.user: options.password}, port=options.port
        ),
        lambda server: f"{server.url} takes change sets of {options.user}",
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m nvdb.replay.skriv",
        description="Take change sets as API Skriv V3 would; nothing leaves this machine or is kept.",
        epilog="Example: python -m nvdb.replay.skriv recorded_pages --port 8097",
    )
    parser.add_argument("folder", type=Path, help="folder of recorded pages (*.json, *.json.gz, *.ndjson)")
    parser.add_argument("--port", type=int, default=8097, help="0 takes a free one (default: %(default)s)")
    parser.add_argument("--user", default="demo", help="the one who may log in (default: %(default)s)")
    parser.add_argument("--password", default="demo", help="of that user (default: %(default)s)")
    return parser


if __name__ == "__main__":
    sys.exit(main())
