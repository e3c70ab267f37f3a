"""What a mirror must survive. After each fault the visible mirror is the old or the new one, nothing else."""

from __future__ import annotations

import json
import re
from typing import Any

import pytest
from mirror_bench import visible_at
from mirror_scene import GENERATED, N_POINTS, PLATES, Scene

from nvdb.client import NvdbClient
from nvdb.client.client import RETRY_AFTER_CAP_S
from nvdb.errors import PagingError, SchemaError, TransportError
from nvdb.mirror import MassDeletionError, ShortBackfillError
from nvdb.objects import in_norway
from nvdb.replay import Fault, RequestInfo
from twin.cli.exit_codes import exit_code

CLIENT_DEFAULTS: dict[str, Any] = NvdbClient.__init__.__kwdefaults__ or {}
Raw = dict[str, Any]


@pytest.mark.parametrize("kind", ["truncate", "cut", "damaged_gzip", "disconnect", "html_200", "garbage"])
def test_body_that_is_no_answer(scene: Scene, kind: Any) -> None:
    """Half a body, with or without a declared length, is never half a page; nor is a gateway's HTML.

    A fault that lasts leaves the old mirror, wherever it sets in; one that passes does no harm.
    """
    fault = Fault(kind)
    for fresh, first in ((False, 0), (True, 4)):
        scene.faults = lambda _, first=first: fault if scene.asked > first else None  # type: ignore[misc]
        assert isinstance(scene.attempt(fresh=fresh), TransportError)
        scene.stays_old()
    scene.faults = lambda info: fault if info.number % 2 == 0 else None
    for fresh in (False, True):
        assert scene.attempt(fresh=fresh) is None
    scene.gets_new()


@pytest.mark.parametrize("status", [429, 503])
def test_429_and_503_with_every_form_of_retry_after(
    scene: Scene, status: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Seconds, dates and absurd values: the client waits, but never beyond its cap, and then goes on."""
    waits: list[float] = []
    monkeypatch.setitem(CLIENT_DEFAULTS, "sleep", waits.append)
    forms = [
        *("0", "7", "2.5", "99999999999", "-5", "soon", "", "1e9", "\u00e6"),
        *("Wed, 21 Oct 2015 07:28:00 GMT", "Fri, 31 Dec 9999 23:59:59 GMT", "Fri, 99 Foo 2026 99:99:99 GMT"),
    ]
    answers = [Fault("status", status, headers={"Retry-After": form}) for form in forms]
    lasting = Fault("status", status, headers={"Retry-After": "86400"})
    scene.faults = lambda _: lasting
    assert isinstance(scene.attempt(fresh=True), TransportError)
    scene.stays_old()
    # Every other request fails, each time in another form.
    scene.faults = lambda info: answers[info.number // 2 % len(answers)] if info.number % 2 else None
    for _ in range(2):
        assert scene.attempt(fresh=True) is None
    assert max(waits) == RETRY_AFTER_CAP_S
    assert any(7 <= wait < 10 for wait in waits)
    scene.gets_new()


def test_slow_drip_past_the_deadline(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """An answer that never ends is given up."""
    monkeypatch.setitem(CLIENT_DEFAULTS, "deadline_s", 0.2)
    for fresh in (False, True):
        scene.faults = lambda _: Fault("drip", pause_s=0.05) if scene.asked == 2 else None
        assert isinstance(scene.attempt(fresh=fresh), TransportError)
        scene.stays_old()
    monkeypatch.undo()
    scene.gets_new()


def test_redirect_loops(scene: Scene) -> None:
    """A redirect to itself is not followed for ever."""
    for fresh in (False, True):
        scene.faults = lambda _: Fault("redirect_loop") if scene.asked > 1 else None
        assert isinstance(scene.attempt(fresh=fresh), TransportError)
        scene.stays_old()
    scene.gets_new()


@pytest.mark.parametrize("kind", ["repeat_page", "repeat_cursor"])
def test_repeated_page_and_repeated_cursor(scene: Scene, kind: Any) -> None:
    """A page that comes again hides another: an error, and not the end of the pages."""

    def again(info: RequestInfo) -> Fault | None:
        return Fault(kind) if "start" in info.query and "/96" in info.path else None

    scene.faults = again
    for _ in range(3):  # also when it is resumed from the page where it stopped
        assert isinstance(scene.attempt(fresh=True), PagingError | ShortBackfillError | MassDeletionError)
        scene.stays_old()
    scene.gets_new(fresh=True)


@pytest.mark.parametrize("size", [1, 11])
def test_short_page(scene: Scene, size: int) -> None:
    """A page that is shorter than asked for is not the last."""
    scene.world.page_limit = size
    scene.gets_new(fresh=True)


def test_empty_page_in_the_middle(scene: Scene) -> None:
    """An empty page looks like the end; the count of the API tells that it is not."""
    name = "objekter" if scene.source == "les-v4" else "vegobjekter"
    empty = Fault("status", 200, body=json.dumps({name: [], "metadata": {"returnert": 0}}).encode())
    scene.faults = lambda info: empty if "start" in info.query and "/96" in info.path else None
    assert isinstance(scene.attempt(fresh=True), ShortBackfillError)
    scene.stays_old()
    scene.gets_new(fresh=True)


def test_page_order_changing_between_runs(scene: Scene) -> None:
    """A backfill that is resumed in another order begins anew as soon as it lacks anything."""
    for seed in (1, 2, 3):
        scene.world.order_seed = seed
        scene.faults = lambda _: Fault("status", 403) if scene.asked > 6 else None
        assert scene.attempt(fresh=True) is not None
        scene.stays_old()
    scene.world.order_seed = 4
    scene.faults = lambda _: None
    scene.sync()
    scene.world.order_seed = None
    assert visible_at(scene.path) == scene.new() != scene.old


@pytest.mark.parametrize("drift", ["new", "missing", "null"])
def test_schema_drift_of_fields(scene: Scene, drift: str) -> None:
    """New fields are kept with the object, and missing ones leave what depends on them empty."""

    def change(made: Raw, api: str) -> Raw:
        if drift == "new":
            return {**made, "nyttFelt": {"dypt": [1, {"nede": None}]}}
        kept = {"id", "versjon", "typeId", "gyldighetsperiode", "metadata"}
        return {
            name: part if name in kept else None
            for name, part in made.items()
            if drift == "null" or name in kept
        }

    scene.world.drift = change
    scene.sync()
    changed = visible_at(scene.path)[96, PLATES[3]]
    assert ("nyttFelt" in changed["raw"]) == (drift == "new")
    assert (changed["east_m"] is None) == (drift != "new")


def test_schema_drift_of_a_type(scene: Scene) -> None:
    """One object in a broken form keeps its old state and is named; a page of them stops the sync."""
    odd = {PLATES[3]}
    scene.world.drift = lambda made, api: {**made, "egenskaper": 7} if made["id"] in odd else made
    for fresh in (False, True):
        result = scene.sync(fresh=fresh)
        assert any(str(PLATES[3]) in problem for problem in result.problems)
        assert visible_at(scene.path)[96, PLATES[3]] == scene.old[96, PLATES[3]]
    before = visible_at(scene.path)
    odd |= set(PLATES)
    assert isinstance(scene.attempt(fresh=True), SchemaError)
    assert visible_at(scene.path) == before
    scene.world.drift = None
    scene.gets_new()


def moved(made: Raw, wkt: str, srid: object = None) -> Raw:
    """An object with other coordinates, in either API's form."""
    text = json.dumps(made)
    copy: Raw = json.loads(text)
    holders = [copy.get("geometri"), *(e.get("verdi") for e in dict_values(copy)), *dict_values(copy)]
    for holder in holders:
        if isinstance(holder, dict):
            for name in ("wkt", "verdi"):
                if isinstance(holder.get(name), str) and holder[name].startswith("POINT"):
                    holder[name] = wkt
                    if srid is not None:
                        holder["srid"] = srid
    return copy


def dict_values(made: Raw) -> list[Raw]:
    """The properties of an object, in either API's form."""
    found = made.get("egenskaper") or []
    return list(found.values()) if isinstance(found, dict) else list(found)


ABSURD = (
    ("POINT Z (7040000 270000 50)", None),  # swapped axes
    ("POINT Z (63.4 10.4 50)", None),  # degrees where metres should be
    ("POINT Z (1e300 7040000 50)", None),
    ("POINT Z (-270000 -7040000 50)", None),
    ("POINT Z (NaN 7040000 50)", None),
    ("POINT EMPTY", None),
    ("POINT Z (270000 7040000 50)", 3857),  # a system that NVDB does not have
    ("POINT Z (270000 7040000 50)", "utm"),
)


def test_swapped_axes_and_absurd_coordinates_and_wrong_srid(scene: Scene) -> None:
    """A sign whose coordinates cannot be is kept without a position, and said; it never stands elsewhere."""
    odd = dict(zip(PLATES, ABSURD, strict=False))
    scene.world.drift = lambda made, api: moved(made, *odd[made["id"]]) if made["id"] in odd else made
    scene.world.touch(odd)
    result = scene.sync()
    rows = visible_at(scene.path)
    assert rows == scene.new()
    for (_, number), row in rows.items():
        if number in odd:
            assert (row["east_m"], row["north_m"]) == (None, None)
            assert any(f"Vegobjekt {number}: " in problem for problem in result.problems)
        elif row["east_m"] is not None:
            assert in_norway(row["east_m"], row["north_m"])


@pytest.mark.parametrize("fresh", [False, True])
def test_mass_deletion(scene: Scene, fresh: bool) -> None:
    """An API that has lost its objects is not believed until somebody confirms it; exit code 5."""
    for number in PLATES[10:20]:
        scene.world.remove(number)
    for number in GENERATED.ids(95, N_POINTS):
        scene.world.remove(number)
    for _ in range(2):
        error = scene.attempt(fresh=fresh)
        assert isinstance(error, MassDeletionError)
        assert exit_code(error) == 5
        assert re.search(r"delete \d+ of \d+ Skiltp\w+ .* confirm the deletions", str(error))
        scene.stays_old()
    scene.gets_new(fresh=fresh, confirm_deletions=True)
