"""What the replay server has to serve, and how API Les V4 would cut it into pages.

Objects come from recorded pages on disk (served as they were recorded) or from memory (then `inkluder` and
`srid` are honoured as V4 does). Sources: the V4 parameter documentation and recorded pages.
"""

from __future__ import annotations

import gzip
import json
import logging
import re
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final
from urllib.parse import parse_qs, urlencode, urlsplit

from nvdb import datakatalog
from nvdb.errors import ReplaySourceError, SchemaError
from nvdb.objects.geometri import Position
from nvdb.objects.les_v4 import vegobjekt_from_les_v4
from nvdb.objects.vegobjekt import RawObject
from nvdb.replay.shown import shown

log = logging.getLogger(__name__)

MAX_PAGE: Final = 1000
"""Most objects that V4 puts on one page."""

PLACES: Final[Mapping[str, str]] = {
    "kommune": "kommuner",
    "fylke": "fylker",
    "kontraktsomrade": "kontraktsområder",
}
"""Filter → the list in ``lokasjon`` that it looks into."""

_SUFFIXES: Final = (".json", ".ndjson", ".jsonl", ".json.gz", ".ndjson.gz", ".jsonl.gz")
VEGNETT_PREFIX: Final = "vegnett"
"""Files of a recorded folder whose names begin so hold segments of the road network."""
_TYPE_IN_PAGE_HREF = re.compile(r"/vegobjekter/(\d+)")
_CURSOR = re.compile(r"(\d{1,18}):(\d{1,9})")

Generated = Mapping[int, Sequence[RawObject]]
Places = frozenset[tuple[str, str]]
"""Filter and value, such as ``("fylke", "50")``, for each area that an object lies in."""


class QueryError(ValueError):
    """A query that V4 answers with 400; the text is ProblemDetail's detail."""


@dataclass(frozen=True, slots=True)
class Record:
    """One object to serve, with what the filters need to know of it."""

    type_id: int
    id: int
    versjon: int
    raw: RawObject
    recorded: bool
    places: Places
    position: Position | None

    @property
    def cursor(self) -> str:
        """``<id>:<versjon>``, as V4 writes it."""
        return f"{self.id}:{self.versjon}"


class ReplaySource:
    """Objects by type, in the order in which V4 sends them.

    Parameters
    ----------
    source : Path, str or mapping
        A folder of recorded pages, or object type → objects in V4's form.

    Raises
    ------
    ReplaySourceError
        No such folder, a file that is not JSON, an object that cannot be placed, or nothing at all.
    """

    def __init__(self, source: Path | str | Generated) -> None:
        if isinstance(source, Mapping):
            records = _from_memory(source)
            known = set(source)
        else:
            records = _from_folder(Path(source))
            known = set()
        self._records: dict[int, list[Record]] = {}
        for record in _newest(records):
            self._records.setdefault(record.type_id, []).append(record)
        self.vegnett: Sequence[RawObject] | None = (
            None if isinstance(source, Mapping) else _vegnett(Path(source))
        )
        """Segments of the road network, of files ``vegnett*``; None where nothing is known of it."""
        if not self._records and not known and self.vegnett is None:
            msg = f"{source} holds no vegobjekter: give a folder of API Les V4 pages (*.json, *.json.gz)."
            raise ReplaySourceError(msg)
        self.types = frozenset(self._records) | known | {datakatalog.SKILTPUNKT, datakatalog.SKILTPLATE}
        self.events: list[Any] = []
        """What the change feeds tell (:class:`nvdb.replay.events.Hendelse`); a world fills it."""
        self.page_limit: int | None = None

    def counts(self) -> dict[int, int]:
        """How many objects there are of each type."""
        return {type_id: len(self._records.get(type_id, ())) for type_id in sorted(self.types)}

    def areas(self, kind: str) -> list[int]:
        """Numbers of the kommuner or fylker that the objects lie in (`kind`: a filter of `PLACES`)."""
        records = (record for records in self._records.values() for record in records)
        return sorted({int(text) for record in records for name, text in record.places if name == kind})

    def select(self, type_id: int, query: Mapping[str, str]) -> list[Record]:
        """Objects that pass ``ider``, ``kartutsnitt`` and the filters of `PLACES`, ordered by id."""
        records = self._records.get(type_id, [])
        if "ider" in query:
            ids = set(read_integers(query["ider"], "ider"))
            records = [record for record in records if record.id in ids]
        for name in PLACES.keys() & query.keys():
            places = read_places(name, query[name])
            records = [record for record in records if record.places & places]
        if "kartutsnitt" in query:
            box = read_box(query["kartutsnitt"])
            records = [record for record in records if _inside(record.position, box)]
        return list(records)

    def page(self, type_id: int, query: Mapping[str, str], page_url: str) -> dict[str, Any]:
        """One page as V4 sends it.

        The end is an empty page that repeats the cursor; a query without hits has no ``neste``.
        """
        hits = self.select(type_id, query)
        size = read_page_size(query)
        start = query.get("start")
        hits.sort(key=lambda record: self.order(record.id, record.versjon))
        if start is None:
            rest = hits
        else:
            after = self.order(*_cursor(start))
            rest = [record for record in hits if self.order(record.id, record.versjon) > after]
        page = rest[: min(size, self.page_limit or size)]
        metadata: dict[str, Any] = {"returnert": len(page), "sidestørrelse": size}
        if query.get("inkluderAntall", "").lower() == "true":
            metadata["antall"] = len(hits)
        cursor = page[-1].cursor if page else start
        if cursor is not None:
            metadata["neste"] = neste(page_url, query, cursor)
        objects = [self.show(dict(self.form(record, query, page_url)), "les-v4") for record in page]
        return {"objekter": objects, "metadata": metadata}

    def page_body(self, type_id: int, query: Mapping[str, str], page_url: str) -> bytes:
        """One page of V4, as JSON."""
        return json.dumps(self.page(type_id, query, page_url), ensure_ascii=False).encode()

    def count(self, type_id: int, query: Mapping[str, str]) -> int:
        """How many objects pass the filters."""
        return len(self.select(type_id, query))

    def uberiket_body(self, type_id: int, query: Mapping[str, str], url: str) -> bytes | None:
        """One page of Uberiket as JSON, where the source has a quick way to make it; else None."""
        del type_id, query, url  # generated worlds have one
        return None

    def versions(self, type_id: int, query: Mapping[str, str]) -> list[Record]:  # noqa: ARG002 (worlds use it)
        """All versions of the objects of a type, ordered by id and version, before any filter."""
        return list(self._records.get(type_id, []))

    def order(self, record_id: int, versjon: int) -> tuple[float, int, int]:
        """Sort key of the order of pages: the id, as V4 does."""
        return 0.0, record_id, versjon

    def show(self, made: dict[str, Any], api: str) -> dict[str, Any]:  # noqa: ARG002 (worlds use it)
        """Last look at an object before it is shown by an API (``les-v4`` or ``uberiket``)."""
        return made

    def now(self) -> datetime:
        """Give the time by which the change feed measures its reach."""
        return datetime.now(UTC)

    def one(self, type_id: int, object_id: int) -> Record | None:
        """The object of a type and id, or None."""
        return next((r for r in self._records.get(type_id, []) if r.id == object_id), None)

    @staticmethod
    def form(record: Record, query: Mapping[str, str], page_url: str) -> RawObject:
        """An object as the query wants it; recorded ones as they were recorded."""
        if record.recorded:
            return record.raw
        try:
            return shown(record.raw, query, f"{page_url}/{record.id}")
        except ValueError as error:
            raise QueryError(str(error)) from error


def neste(page_url: str, query: Mapping[str, str], cursor: str) -> dict[str, str]:
    """``metadata.neste``: the cursor, and the same query with it."""
    others = {name: value for name, value in query.items() if name not in {"start", "antall"}}
    last = {"start": cursor} | ({"antall": query["antall"]} if "antall" in query else {})
    return {"start": cursor, "href": f"{page_url}?{urlencode(others | last, safe=':,')}"}


def read_page_size(query: Mapping[str, str]) -> int:
    """``antall``: V4 sends at most 1000, whatever is asked."""
    text = query.get("antall", str(MAX_PAGE))
    if not (text.isascii() and text.isdigit()) or int(text) < 1:
        msg = f"antall: '{text}' er ikke et positivt heltall"
        raise QueryError(msg)
    return min(int(text), MAX_PAGE)


def _cursor(text: str) -> tuple[int, int]:
    match = _CURSOR.fullmatch(text)
    if match is None:
        msg = f"start: '{text}' er ikke et gyldig startpunkt"
        raise QueryError(msg)
    return int(match.group(1)), int(match.group(2))


def read_integers(text: str, name: str) -> list[int]:
    """Read a list of whole numbers with commas between; QueryError if it is none."""
    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        msg = f"{name}: '{text}' er ikke en liste av heltall"
        raise QueryError(msg) from None


def read_places(name: str, text: str) -> Places:
    """Read a filter of `PLACES`: numbers, or names of kontraktsområder; QueryError if it is neither."""
    if name == "kontraktsomrade":
        return frozenset((name, part.strip()) for part in text.split(","))
    return frozenset((name, str(number)) for number in read_integers(text, name))


def places_of(lokasjon: object) -> Places:
    """Kommuner, fylker, and ids and names of kontraktsområder that ``lokasjon`` lists."""
    found = set()
    for name, listed in PLACES.items():
        items = lokasjon.get(listed) if isinstance(lokasjon, Mapping) else None
        for item in items if isinstance(items, list) else ():
            values = (item.get("id"), item.get("navn")) if isinstance(item, Mapping) else (item,)
            found |= {(name, str(value)) for value in values if value is not None}
    return frozenset(found)


def read_box(text: str) -> list[float]:
    """Read ``kartutsnitt``; QueryError if it is not four numbers."""
    try:
        box = [float(part) for part in text.split(",")]
    except ValueError:
        box = []
    if len(box) != 4:
        msg = f"kartutsnitt: '{text}' er ikke minX,minY,maxX,maxY"
        raise QueryError(msg)
    return box


def _inside(position: Position | None, box: Sequence[float]) -> bool:
    if position is None:
        return False
    return box[0] <= position.east_m <= box[2] and box[1] <= position.north_m <= box[3]


def _newest(records: Iterable[Record]) -> list[Record]:
    """One record an object, of its highest version, in V4's order; the places of its copies are joined."""
    newest: dict[tuple[int, int], Record] = {}
    for record in records:
        key = (record.type_id, record.id)
        other = newest.get(key, record)
        best = max(other, record, key=lambda r: r.versjon)
        newest[key] = replace(best, places=other.places | record.places)
    return [newest[key] for key in sorted(newest)]


def record_from_raw(raw: RawObject, type_id: int) -> Record:
    """Make a record of one object in V4's form; ReplaySourceError if it has no id."""
    return _record(raw, type_id, recorded=False)


def _record(raw: RawObject, type_id: int | None, recorded: bool, asked: Places = frozenset()) -> Record:
    """Read what the filters need. An object that breaks V4's form is served too: clients must survive it."""
    kind, position = type_id, None
    try:
        vegobjekt = vegobjekt_from_les_v4(raw, type_id=type_id)
    except SchemaError:
        metadata = raw.get("metadata")
        versjon = metadata.get("versjon") if isinstance(metadata, Mapping) else None
    else:
        kind, position, versjon = vegobjekt.type_id, vegobjekt.position, vegobjekt.versjon
    object_id = raw.get("id")
    if kind is None or not isinstance(object_id, int):
        msg = "has neither a type nor an id"
        raise ReplaySourceError(msg)
    places = places_of(raw.get("lokasjon")) or asked
    return Record(
        kind, object_id, versjon if isinstance(versjon, int) else 1, raw, recorded, places, position
    )


def _from_memory(source: Generated) -> Iterator[Record]:
    for type_id, objects in source.items():
        for number, raw in enumerate(objects):
            try:
                yield _record(raw, type_id, recorded=False)
            except ReplaySourceError as error:
                msg = f"Object {number} of type {type_id} {error}: give every object an integer id."
                raise ReplaySourceError(msg) from error


def _from_folder(folder: Path) -> Iterator[Record]:
    if not folder.is_dir():
        msg = f"{folder} is not a folder: give a folder of API Les V4 pages (*.json, *.json.gz)."
        raise ReplaySourceError(msg)
    for path in sorted(folder.iterdir()):
        if _is_data(path) and not path.name.startswith(VEGNETT_PREFIX):
            yield from _from_file(path)


def _vegnett(folder: Path) -> list[RawObject] | None:
    """Segments of all files ``vegnett*`` of a folder; None if there are no such files."""
    paths = [path for path in sorted(folder.glob(f"{VEGNETT_PREFIX}*")) if _is_data(path)]
    found = [raw for path in paths for document in _documents(path) for raw in _page_facts(document)[0]]
    return found if paths else None


def _is_data(path: Path) -> bool:
    return path.name.endswith(_SUFFIXES) and path.is_file()


def _from_file(path: Path) -> Iterator[Record]:
    """Records of one file: a page, a list of objects, or one object a line. Anything else is passed over."""
    for document in _documents(path):
        objects, type_id, asked = _page_facts(document)
        for raw in objects:
            try:
                yield _record(raw, type_id, recorded=True, asked=asked)
            except ReplaySourceError as error:
                if isinstance(document, Mapping) and "objekter" in document:
                    msg = f"An object of {path.name} in {path.parent} {error}: record the page again."
                    raise ReplaySourceError(msg) from error
                # A recorded folder may hold other answers too, such as the list of kommuner.
                log.info("%s: an entry that is no vegobjekt is passed over", path.name)


def _page_facts(document: object) -> tuple[list[RawObject], int | None, Places]:
    """Objects of a document, and the type and places that the page's own ``neste`` tells."""
    if isinstance(document, list):
        return [item for item in document if isinstance(item, Mapping)], None, frozenset()
    if not isinstance(document, Mapping):
        return [], None, frozenset()
    if "objekter" not in document:
        return [document], None, frozenset()
    metadata = document.get("metadata")
    following = metadata.get("neste") if isinstance(metadata, Mapping) else None
    href = following.get("href") if isinstance(following, Mapping) else None
    parts = urlsplit(href if isinstance(href, str) else "")
    match = _TYPE_IN_PAGE_HREF.search(parts.path)
    query = parse_qs(parts.query)
    objects = document["objekter"]
    return (
        [item for item in objects if isinstance(item, Mapping)] if isinstance(objects, list) else [],
        int(match.group(1)) if match else None,
        frozenset(place for name in PLACES for text in query.get(name, []) for place in _asked(name, text)),
    )


def _asked(name: str, text: str) -> Places:
    """Places of a recorded address; none where it cannot be read."""
    try:
        return read_places(name, text)
    except QueryError:
        return frozenset()


def _documents(path: Path) -> Iterator[object]:
    """JSON documents of a file: one, or one a line."""
    try:
        data = path.read_bytes()
        text = (gzip.decompress(data) if path.suffix == ".gz" else data).decode("utf-8-sig")
    except (OSError, EOFError, zlib.error, UnicodeDecodeError) as error:
        msg = f"{path.name} in {path.parent} cannot be read ({error}): record it again or take it away."
        raise ReplaySourceError(msg) from error
    lines = [text] if ".json" in path.suffixes else text.splitlines()
    try:
        yield from [json.loads(line) for line in lines if line.strip()]
    except ValueError as error:
        msg = f"{path.name} in {path.parent} is not JSON ({error}): record it again or take it away."
        raise ReplaySourceError(msg) from error
