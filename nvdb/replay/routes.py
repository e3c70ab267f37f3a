"""Which address answers what: API Les V4, Uberiket V1 and the datakatalog over one source."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from typing import Any, Final

from nvdb.datakatalog.katalog import Datakatalog, snapshot
from nvdb.replay.events import endringer_page, hendelser_page, newest
from nvdb.replay.loopback import Answer
from nvdb.replay.pages import QueryError, Record, ReplaySource, neste
from nvdb.replay.uberiket import (
    cut,
    numbers,
    page_document,
    page_size,
    select_versions,
    shown_parts,
    uberiket_from_les_v4,
)
from nvdb.replay.vegnett import cut_segments, select_segments

UBERIKET: Final = "/uberiket/api/v1"
KATALOG: Final = "/datakatalog/api/v1"


def json_answer(status: int, document: object, content_type: str = "application/json") -> Answer:
    """Make an answer of a document."""
    return Answer(status, json.dumps(document, ensure_ascii=False).encode(), content_type)


def problem(status: int, title: str, detail: str, instance: str) -> Answer:
    """ProblemDetail, RFC 9457."""
    document = {
        "type": "about:blank",
        "title": title,
        "status": status,
        "detail": detail,
        "instance": instance,
    }
    return json_answer(status, document, "application/problem+json")


class Routes:
    """Answers for one source.

    Parameters
    ----------
    source : ReplaySource
    katalog : Datakatalog, optional
        What the datakatalog's addresses say; the snapshot if omitted.
    """

    def __init__(self, source: ReplaySource, katalog: Datakatalog | None = None) -> None:
        self.source = source
        self.katalog = katalog or snapshot()
        v4 = r"/vegobjekter(?:/api/v4/vegobjekter)?"
        self._routes: list[tuple[re.Pattern[str], Callable[..., Answer]]] = [
            (re.compile(rf"{v4}/endringer/?"), self._endringer),
            (re.compile(rf"{v4}/(?P<type_id>\d{{1,9}})/endringer/?"), self._endringer),
            (re.compile(rf"{v4}/(?P<type_id>\d{{1,9}})/?"), self._objects),
            (re.compile(rf"{v4}/(?P<type_id>\d{{1,9}})/statistikk/?"), self._statistikk),
            (re.compile(rf"{v4}/(?P<type_id>\d{{1,9}})/(?P<object_id>\d{{1,18}})/?"), self._object),
            (re.compile(rf"{UBERIKET}/vegobjekter/(?P<type_id>\d{{1,9}})/?"), self._versions),
            (re.compile(rf"{UBERIKET}/hendelser/vegobjekter/?"), self._hendelser),
            (re.compile(rf"{UBERIKET}/hendelser/vegobjekter/(?P<type_id>\d{{1,9}})/?"), self._hendelser),
            (re.compile(rf"{UBERIKET}/hendelser/vegobjekter/(?P<type_id>\d{{1,9}})/siste/?"), self._siste),
            (re.compile(r"/vegnett(?:/api/v4)?/veglenkesekvenser/segmentert/?"), self._segmentert),
            (re.compile(r"/omrader(?:/api/v4)?/kommuner/?"), self._kommuner),
            (re.compile(r"/omrader(?:/api/v4)?/fylker/?"), self._fylker),
            (re.compile(rf"{KATALOG}/versjon/?"), self._versjon),
            (re.compile(rf"{KATALOG}/vegobjekttyper/(?P<type_id>\d{{1,9}})/?"), self._vegobjekttype),
        ]

    def answer(self, path: str, query: Mapping[str, str], base: str, fault: str | None = None) -> Answer:
        """Answer a GET.

        Parameters
        ----------
        path : str
        query : mapping
        base : str
            ``http://host``, for the addresses in the answer.
        fault : str, optional
            ``repeat_cursor``, ``repeat_page`` or ``empty_page``: faults of the content and not of the wire.
        """
        for pattern, make in self._routes:
            match = pattern.fullmatch(path)
            if match is None:
                continue
            found = {name: int(text) for name, text in match.groupdict().items()}
            if found.get("type_id", 95) not in self.source.types:
                return problem(404, "Not Found", f"Vegobjekttype {found['type_id']} finnes ikke", path)
            try:
                answer = make(query, f"{base}{path}", **found)
                if fault is not None:
                    return self._faulty(answer, make, query, f"{base}{path}", found, fault)
            except QueryError as error:
                return problem(400, "Bad Request", str(error), path)
            return answer
        return problem(404, "Not Found", f"No static resource {path.lstrip('/')}.", path)

    @staticmethod
    def _faulty(
        good: Answer,
        make: Callable[..., Answer],
        query: Mapping[str, str],
        url: str,
        found: Mapping[str, int],
        fault: str,
    ) -> Answer:
        """Make the good page lead back to itself, come empty, or show the first page's objects."""
        document = json.loads(good.body)
        metadata = document.get("metadata")
        if not isinstance(metadata, dict):
            return good
        if fault == "repeat_cursor":
            metadata["neste"] = neste(url, query, query.get("start", "0:0"))
            return json_answer(200, document)
        if fault == "empty_page":
            name, sign = ("vegobjekter", "-") if "vegobjekter" in document else ("objekter", ":")
            first_id = (document.get(name) or [{}])[0].get("id")
            if first_id is not None:
                metadata["neste"] = neste(url, query, f"{first_id - 1}{sign}{10**9 - 1}")
                document[name], metadata["returnert"] = [], 0
            return json_answer(200, document)
        first = make({name: text for name, text in query.items() if name != "start"}, url, **found)
        return json_answer(200, {**json.loads(first.body), "metadata": metadata})

    def _objects(self, query: Mapping[str, str], url: str, type_id: int) -> Answer:
        return Answer(200, self.source.page_body(type_id, query, _plain(url, type_id)))

    def _statistikk(self, query: Mapping[str, str], url: str, type_id: int) -> Answer:  # noqa: ARG002 (as all)
        return json_answer(200, {"antall": self.source.count(type_id, query), "lengde": 0.0})

    def _object(self, query: Mapping[str, str], url: str, type_id: int, object_id: int) -> Answer:
        record = self.source.one(type_id, object_id)
        if record is None:
            detail = f"Fant ikke vegobjekt {object_id} av type {type_id}"
            return problem(404, "Not Found", detail, url.partition("://")[2])
        # V4 shows a single object whole unless told otherwise.
        made = self.source.form(record, {"inkluder": "alle", **query}, _plain(url, type_id))
        return json_answer(200, self.source.show(dict(made), "les-v4"))

    def _endringer(self, query: Mapping[str, str], url: str, type_id: int | None = None) -> Answer:
        types = {type_id} if type_id is not None else set(numbers(query.get("typeIder", ""), "typeIder"))
        return json_answer(200, endringer_page(self.source.events, types, query, url, self.source.now()))

    def _versions(self, query: Mapping[str, str], url: str, type_id: int) -> Answer:
        body = self.source.uberiket_body(type_id, query, url)
        if body is not None:
            return Answer(200, body)
        records = select_versions(self.source.versions(type_id, query), query)
        page, cursor = cut(records, query, self.source.page_limit)
        objects = [self._uberiket(record, query) for record in page]
        return json_answer(200, page_document("vegobjekter", objects, page_size(query), cursor, url, query))

    def _uberiket(self, record: Record, query: Mapping[str, str]) -> dict[str, Any]:
        made = shown_parts(uberiket_from_les_v4(record.raw, record.type_id), query)
        return self.source.show(made, "uberiket")

    def _hendelser(self, query: Mapping[str, str], url: str, type_id: int | None = None) -> Answer:
        types = None if "typeIder" not in query else set(numbers(query["typeIder"], "typeIder"))
        return json_answer(
            200,
            hendelser_page(self.source.events, {type_id} if type_id is not None else types, query, url),
        )

    def _siste(self, query: Mapping[str, str], url: str, type_id: int) -> Answer:  # noqa: ARG002 (as all)
        event = newest(self.source.events, type_id)
        if event is None:
            return problem(404, "Not Found", f"Ingen hendelser for vegobjekttype {type_id}", url)
        return json_answer(200, event)

    def _segmentert(self, query: Mapping[str, str], url: str) -> Answer:
        if self.source.vegnett is None:
            detail = "Intet vegnett er tatt opp: legg sider i filer som heter vegnett*.json"
            return problem(404, "Not Found", detail, url.partition("://")[2])
        today = self.source.now().date().isoformat()
        found = select_segments(self.source.vegnett, query, today)
        page, size, cursor = cut_segments(found, query, self.source.page_limit)
        metadata: dict[str, Any] = {"returnert": len(page), "sidestørrelse": size}
        if query.get("inkluderAntall", "").lower() == "true":
            metadata["antall"] = len(found)
        if cursor is not None:
            metadata["neste"] = neste(url, query, cursor)
        return json_answer(200, {"objekter": page, "metadata": metadata})

    def _kommuner(self, query: Mapping[str, str], url: str) -> Answer:
        return self._omrader("kommune", query, url)

    def _fylker(self, query: Mapping[str, str], url: str) -> Answer:
        return self._omrader("fylke", query, url)

    def _omrader(self, kind: str, query: Mapping[str, str], url: str) -> Answer:
        """The numbers that the objects name: recordings do not hold the areas' own list, with names."""
        del query  # all are shown, whatever is asked
        numbers = self.source.areas(kind)
        if not numbers:
            return problem(404, "Not Found", f"Ingen vegobjekter sier {kind}", url.partition("://")[2])
        return json_answer(200, [{"nummer": number} for number in numbers])

    def _versjon(self, query: Mapping[str, str], url: str) -> Answer:  # noqa: ARG002 (as all)
        return json_answer(200, {"id": 1, "dato": self.katalog.date, "versjon": self.katalog.version})

    def _vegobjekttype(self, query: Mapping[str, str], url: str, type_id: int) -> Answer:
        del query  # the whole type is shown, whatever is asked
        if type_id not in self.katalog.typer:
            return problem(404, "Not Found", f"Vegobjekttype {type_id} finnes ikke", url)
        return json_answer(200, vegobjekttype_document(self.katalog, type_id))


def _stedfesting(katalog: Datakatalog, type_id: int) -> dict[str, Any]:
    krav = katalog.stedfesting.get(type_id)
    if krav is None:
        return {}
    said = {
        "egenskapstype": "Stedfesting",
        "retning_relevant": krav.retning,
        "sideposisjon_relevant": krav.sideposisjon,
        "kjørefelt_relevant": krav.kjorefelt,
    }
    return {"stedfesting": {name: value for name, value in said.items() if value is not None}}


def vegobjekttype_document(katalog: Datakatalog, type_id: int) -> dict[str, Any]:
    """One type as the datakatalog API shows it."""
    return {
        "id": type_id,
        "navn": katalog.typer[type_id],
        **_stedfesting(katalog, type_id),
        "egenskapstyper": [
            {
                "id": kind.id,
                "navn": kind.navn,
                "egenskapstype": kind.egenskapstype,
                **(
                    {"tillatte_verdier": [{"id": n, "verdi": v} for n, v in kind.verdier.items()]}
                    if kind.verdier
                    else {}
                ),
            }
            for kind in katalog.egenskapstyper.values()
            if kind.type_id == type_id
        ],
        "relasjonstyper": {
            "foreldre": [],
            "barn": [
                {"id": relation, "innhold": {"id": relation, "type": {"id": child}}}
                for relation, child in katalog.barn.items()
                if type_id == 95
            ],
        },
    }


def _plain(url: str, type_id: int) -> str:
    """Address that V4's own answers name, whichever of the two was asked."""
    scheme, _, rest = url.partition("://")
    return f"{scheme}://{rest.partition('/')[0]}/vegobjekter/{type_id}"
