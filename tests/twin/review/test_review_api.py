"""The review page's API on the sample: four findings to settle."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sqlalchemy as sa
from command_line import Twin
from review_browser import Browser, Open

from twin.cli import run
from twin.decisions.explain import explain_change
from twin.decisions.record import decide
from twin.evidence import gaps_of
from twin.evidence.crops import Crop, FaceFrom, MaskProof, Role
from twin.evidence.files import write_crop
from twin.store import schema
from twin.store.store import Store
from twin.words import Lang

MISSING, NEW, WRONG_TYPE, MOVED = "e679cb267742", "89cb19927fd6", "4567abf7173d", "45ca7449d96d"
Server = Callable[..., Open]


def log(store: Path) -> list[tuple[Any, ...]]:
    """Return what the log holds: change, kind, decision, comment, by whom."""
    c = schema.decision_log.c
    with Store.open(store) as opened:
        rows = opened.rows(sa.select(c.change_id, c.kind, c.decision, c.reason, c.by).order_by(c.id))
    return [tuple(row.values()) for row in rows]


def test_session_tells_what_there_is(page: Browser) -> None:
    """Counts by verdict, roads, drives, kommuner and the bounds of all findings."""
    session = page.get("session")
    assert session["counts"]["missing"] == {"open": 1, "accept": 0, "dismiss": 0, "defer": 0}
    assert list(session["counts"]) == ["missing", "new", "wrong_type", "moved"]
    assert (session["roads"], session["kommuner"]) == (["KV2210"], [5001])
    assert [drive["name"] for drive in session["drives"]] == ["trip_trondheim"]
    assert (session["reviewer"], session["notice"], session["read_only"]) == ("kari", None, False)
    west, south, east, north = session["bounds"]
    assert west < east
    assert south < north


@pytest.mark.parametrize(
    ("query", "found"),
    [
        ({}, [MISSING, NEW, WRONG_TYPE, MOVED]),
        ({"order": "confidence"}, [NEW, MOVED, MISSING, WRONG_TYPE]),
        ({"order": "road"}, [NEW, MOVED, MISSING, WRONG_TYPE]),
        ({"verdict": "moved"}, [MOVED]),
        ({"road": "KV2210", "kommune": "5001", "drive": "a4fa72eb80eb", "limit": "1"}, [MISSING]),
        ({"offset": "3"}, [MOVED]),
        ({"road": "EV6"}, []),
        ({"kommune": "301"}, []),
        ({"drive": "other"}, []),
        ({"state": "accept"}, []),
    ],
)
def test_list_is_filtered_and_ordered(page: Browser, query: dict[str, str], found: list[str]) -> None:
    """By verdict, road, kommune, drive and state; a piece of it where asked for; meters count as numbers."""
    answer = page.get("findings", **query)
    assert [item["change_id"] for item in answer["items"]] == found


def test_points_are_the_same_findings_as_columns(page: Browser) -> None:
    """Settled ones too, with their state."""
    page.answer(NEW, "accept")
    points = page.get("points")
    assert dict(zip(points["change_id"], points["state"], strict=True)) == {
        MISSING: "open",
        NEW: "accept",
        WRONG_TYPE: "open",
        MOVED: "open",
    }
    (item,) = page.get("findings", state="accept")["items"]
    at = points["change_id"].index(NEW)
    assert (points["lon"][at], points["lat"][at]) == (item["lon"], item["lat"])


def test_finding_shows_claim_beside_what_was_seen(page: Browser) -> None:
    """Codes with their names, where each stands, when it was seen, and what the confidence rests on."""
    found = page.get(f"finding/{WRONG_TYPE}")
    assert found["claim"]["codes"] == [{"code": "362.60", "name": "Fartsgrense 60 km/t"}]
    assert found["seen"]["codes"] == [{"code": "362.50", "name": "Fartsgrense 50 km/t"}]
    assert found["seen_sentence"] == "Seen 10 June 2026 by two cameras."
    assert found["road"] == "KV2210 S1D1 m352"
    assert found["claim"]["url_vegkart"].endswith("1042600114:96")
    assert all(term["label"] and term["value"] and term["explanation"] for term in found["terms"])
    assert found["terms"]
    assert found["can_answer"]
    title = page.get("findings", verdict="new")["items"][0]["title"]
    assert title == "142 – Barn + 802 – Avstand"


def test_map_of_all_shows_where_the_drives_went(page: Browser) -> None:
    """A line a drive, through the middle of the findings."""
    (track,) = page.get("tracks")["features"]
    points = page.get("points")
    assert (track["geometry"]["type"], track["properties"]["kind"]) == ("LineString", "track")
    lon, lat = np.array(track["geometry"]["coordinates"]).T
    assert lon.min() < min(points["lon"]) < lon.max()
    assert lat.min() < min(points["lat"]) < lat.max()


def test_map_shows_rays_to_the_sign_and_where_cameras_look(page: Browser) -> None:
    """Every ray ends at the sign; a camera that saw it looks at it, within its field of view."""
    features = page.get(f"finding/{MOVED}")["map"]["features"]
    kinds = [feature["properties"]["kind"] for feature in features]
    assert set(kinds) == {"track", "ray", "camera", "ellipse", "nvdb", "seen", "neighbour"}
    (seen,) = (f["geometry"]["coordinates"] for f in features if f["properties"]["kind"] == "seen")
    assert all(f["geometry"]["coordinates"][-1] == seen for f in features if f["properties"]["kind"] == "ray")
    for feature in features:
        if feature["properties"]["kind"] == "camera":
            lon, lat = feature["geometry"]["coordinates"]
            assert abs(_turn(_azimuth(lon, lat, *seen) - feature["properties"]["facing_deg"])) < 65


def _azimuth(lon: float, lat: float, to_lon: float, to_lat: float) -> float:
    import math

    east = (to_lon - lon) * math.cos(math.radians(lat))
    return math.degrees(math.atan2(east, to_lat - lat))


def _turn(degrees: float) -> float:
    return (degrees + 180.0) % 360.0 - 180.0


def test_missing_sign_shows_the_cameras_that_had_its_place_in_view(page: Browser) -> None:
    """There are no rays, and nothing was seen; the place is NVDB's."""
    found = page.get(f"finding/{MISSING}")
    kinds = {feature["properties"]["kind"] for feature in found["map"]["features"]}
    assert {"camera", "track", "nvdb"} <= kinds
    assert not {"ray", "seen", "ellipse"} & kinds
    assert found["seen"] is None
    assert found["seen_sentence"].startswith("Not seen 10 June 2026 by two cameras.")


def test_answer_is_an_entry_of_the_log_and_leads_to_the_next(page: Browser, store: Path) -> None:
    """The comment is its reason, the reviewer its author; the queue goes round until nothing is open."""
    status, done = page.answer(NEW, "accept", "a new crossing")
    assert (status, done["state"], done["next"]) == (200, "accept", WRONG_TYPE)
    assert log(store) == [(NEW, "decided", "accept", "a new crossing", "kari")]
    assert page.answer(MOVED, "defer")[1]["next"] == MISSING
    assert page.answer(MISSING, "dismiss", queue={"verdict": "missing"})[1]["next"] is None
    assert page.answer(WRONG_TYPE, "accept")[1]["next"] is None
    assert page.get("findings")["total"] == 0
    given = page.get("session/answers")["items"]
    assert [one["change_id"] for one in given] == [WRONG_TYPE, MISSING, MOVED, NEW]


def test_request_sent_again_is_kept_once(page: Browser, store: Path) -> None:
    """The page that heard no answer asks with the same key, of an undo too: nothing doubles."""
    seen = page.get(f"finding/{NEW}")["revision"]
    asked = {"change_id": NEW, "answer": "accept", "seen_revision": seen}
    first = page.post("answer", asked, "k1")
    assert page.post("answer", asked, "k1") == first
    page.answer(MOVED, "accept")
    assert page.post("undo", {}, "k2") == page.post("undo", {}, "k2") == (200, {"change_id": MOVED})
    assert [entry[1] for entry in log(store)] == ["decided", "decided", "undone"]


def test_undo_goes_back_to_the_first_answer_of_this_session(server: Server, store: Path) -> None:
    """Answer by answer, own ones only; what another decided since holds."""
    browser = server()
    kari, ola = browser("kari"), browser("ola")
    with Store.open(store) as opened:
        decide(opened, [MISSING], "defer", by="kari")
    kari.answer(NEW, "accept")
    kari.answer(MOVED, "accept")
    ola.answer(WRONG_TYPE, "dismiss")
    ola.answer(NEW, "dismiss")
    assert kari.undo() == (200, {"change_id": MOVED})
    assert kari.undo() == (200, {"change_id": NEW})
    assert kari.undo()[0] == 409
    assert [kari.state(one) for one in (MISSING, NEW, WRONG_TYPE, MOVED)] == [
        "defer",
        "dismiss",
        "dismiss",
        "open",
    ]
    assert ola.undo() == (200, {"change_id": NEW})
    assert ola.state(NEW) == "open"


def test_answer_to_what_has_changed_is_refused(server: Server, store: Path) -> None:
    """Other evidence, or somebody else's other answer, since it was shown: 409, a sentence, nothing kept."""
    browser = server()
    kari, ola = browser("kari"), browser("ola")
    seen = {one: kari.get(f"finding/{one}")["revision"] for one in (NEW, MOVED)}
    ola.answer(NEW, "dismiss")
    asked = {"change_id": NEW, "answer": "accept", "seen_revision": seen[NEW]}
    status, body = kari.post("answer", asked)
    assert (status, "ola has decided since you opened it (dismissed)" in body["error"]) == (409, True)
    with Store.open(store) as opened, opened.transaction() as connection:
        moved = sa.update(schema.change).where(schema.change.c.change_id == MOVED)
        connection.execute(moved.values(skiltnummer_seen="370"))
    status, body = kari.post("answer", {"change_id": MOVED, "answer": "accept", "seen_revision": seen[MOVED]})
    assert (status, "has changed since you opened it" in body["error"]) == (409, True)
    assert [entry[4] for entry in log(store)] == ["ola"]


def test_two_reviewers_who_agree_at_once_are_both_kept(server: Server, store: Path) -> None:
    """Each saw it open and accepted it."""
    browser = server()
    kari, ola = browser("kari"), browser("ola")
    asked = {"change_id": NEW, "answer": "accept", "seen_revision": kari.get(f"finding/{NEW}")["revision"]}
    assert [one.post("answer", asked)[0] for one in (kari, ola)] == [200, 200]
    assert [entry[4] for entry in log(store)] == ["kari", "ola"]


def test_blind_opinions_that_agree_decide_and_others_wait_for_an_open_review(
    server: Server, store: Path
) -> None:
    """Nobody sees the other's answer; one opinion settles nothing, two like ones do, by both names."""
    blind = server(blind=True)
    kari, ola = blind("kari"), blind("ola")
    assert kari.answer(NEW, "accept", "seen it")[1]["state"] == "accept"
    assert (kari.state(NEW), ola.state(NEW)) == ("accept", "open")
    assert ola.get(f"finding/{NEW}")["history"] == []
    kari.answer(MOVED, "accept")
    ola.answer(MOVED, "dismiss", "it leans")
    assert ola.answer(NEW, "accept")[1]["state"] == "accept"
    assert log(store)[-1] == (NEW, "decided", "accept", "seen it", "kari and ola")
    assert ola.get(f"finding/{MOVED}")["history"][0]["by"] == "ola"
    assert len(ola.get(f"finding/{MOVED}")["history"]) == 1
    with Store.open(store) as opened:
        assert explain_change(opened, MOVED).change.is_open
    both = server()("berit")
    assert (both.state(MOVED), both.state(NEW)) == ("disagreement", "accept")
    assert both.get("findings", state="disagreement")["total"] == 1
    assert {one["by"] for one in both.get(f"finding/{MOVED}")["history"]} == {"kari", "ola"}
    agreement = both.get("session")["agreement"]
    assert agreement == {"moved": {"n": 1, "n_agreed": 0}, "new": {"n": 1, "n_agreed": 1}}
    assert both.answer(MOVED, "dismiss")[1]["state"] == "dismiss"


@pytest.mark.parametrize("who", [0, 1])
def test_agreement_falls_with_either_opinion(server: Server, store: Path, who: int) -> None:
    """The first or the second takes theirs back: the finding is open, the other's opinion stands."""
    blind = server(blind=True)
    people = blind("kari"), blind("ola")
    for one in people:
        one.answer(NEW, "accept")
    assert people[who].undo() == (200, {"change_id": NEW})
    assert (people[who].state(NEW), people[1 - who].state(NEW)) == ("open", "accept")
    with Store.open(store) as opened:
        assert explain_change(opened, NEW).change.is_open
    assert people[who].answer(NEW, "accept")[0] == 200
    assert log(store)[-1][1:3] == ("decided", "accept")


def test_stale_findings_are_shown_and_not_answered(server: Server, store: Path) -> None:
    """Synced or ingested after the match: the page is told in a sentence."""
    kari = server()("kari")
    seen = kari.get(f"finding/{NEW}")["revision"]
    with Store.open(store) as opened, opened.transaction() as connection:
        opened.touch(connection)
    assert "run `twin match` again" in kari.get("session")["notice"]
    assert not kari.get(f"finding/{NEW}")["can_answer"]
    status, body = kari.post("answer", {"change_id": NEW, "answer": "accept", "seen_revision": seen})
    assert (status, "run `twin match` again" in body["error"]) == (409, True)
    assert run(["match", "--store", str(store), "--json"]) == 0
    assert kari.answer(NEW, "accept")[0] == 200


def test_read_only_page_answers_nothing(server: Server, store: Path) -> None:
    """By option, and where this user may not write the store."""
    looking = server(read_only=True)("kari")
    assert looking.get("session")["read_only"]
    assert looking.answer(NEW, "accept")[0] == 409
    if os.access in os.supports_effective_ids and os.geteuid() == 0:
        return  # Root may write everything.
    store.chmod(0o444)
    locked = server(store)("kari")
    assert "cannot be written" in locked.get("session")["notice"]
    assert locked.answer(NEW, "accept")[0] == 409


@pytest.mark.parametrize(
    ("body", "status"),
    [
        ({"change_id": NEW, "answer": "open", "seen_revision": ""}, 400),
        ({"change_id": "x' OR 1=1 --", "answer": "accept", "seen_revision": ""}, 400),
        ({"change_id": NEW, "answer": "accept"}, 400),
        ({"change_id": NEW, "answer": "accept", "seen_revision": "", "comment": "x" * 2001}, 400),
        ({"change_id": 7, "answer": "accept", "seen_revision": ""}, 400),
        ([], 400),
        ({"change_id": NEW, "answer": "accept", "seen_revision": ""}, 409),
    ],
)
def test_answer_that_cannot_be_is_refused(page: Browser, store: Path, body: object, status: int) -> None:
    """With a sentence, and the log is as it was."""
    found, told = page.post("answer", body)
    assert (found, log(store)) == (status, [])
    assert told["error"]


def test_nobody_answers_without_a_name(server: Server, store: Path) -> None:
    """The page asks for it first; a name is one line of some letters, and not twin's own."""
    nobody = server()()
    assert nobody.answer(NEW, "accept")[0] == 409
    for name in ("", "  ", "twin", "x" * 81, "a\x00b"):
        assert nobody.post("reviewer", {"name": name})[0] == 400
    assert nobody.post("reviewer", {"name": " Kari  Nordmann "}) == (200, {"reviewer": "Kari Nordmann"})
    # A second tab of the same browser has asked as well.
    assert nobody.post("reviewer", {"name": "Ola"})[0] == 409
    assert nobody.answer(NEW, "accept")[0] == 200
    assert server()("ola").get("session")["reviewers"] == ["Kari Nordmann"]


@pytest.mark.parametrize(
    ("accepted", "lang"),
    [("nb-NO,nb;q=0.9,en;q=0.8", "nb"), ("nn,en;q=0.5", "nb"), ("de,en;q=0.7,no;q=0.3", "en"), ("", "en")],
)
def test_language_is_the_browsers(page: Browser, accepted: str, lang: str) -> None:
    """The most wanted that the page speaks; English where it speaks none."""
    page.http.headers["Accept-Language"] = accepted
    assert page.get("session")["lang"] == lang


def test_crop_is_served_by_its_hash_alone(page: Browser, store: Path) -> None:
    """Of a row of the store; a file that no row names, and any other name, is not there."""
    with Store.open(store) as opened:
        kept, stray = (write_crop(opened.pictures, content)[0] for content in (b"RIFF kept", b"stray"))
        proof = MaskProof(
            "geometry",
            "1",
            FaceFrom.BOX,
            (),
            (),
            (),
            0.5,
            0.25,
            0.25,
            9.0,
            3.0,
            2.0,
            (0, 0, 90, 80),
            0.01,
            "twin",
        )
        taken = ("a4fa72eb80eb", "C2_tricam60", 7, 1781078400 * 10**9, 12.0)
        crop = Crop(NEW, 0, Role.FACE, *taken, kept, 90, 80, True, proof)
        with opened.transaction() as connection:
            connection.execute(sa.insert(schema.crop), [crop.to_row()])
    (shown,) = page.get(f"finding/{NEW}")["crops"]
    assert shown["caption"] == "C2_tricam60, 12 m away, 10 June 2026"
    assert shown["proof"] == "Around the sign 75% was made unrecognisable by the geometry alone."
    assert shown["drive"] == "trip_trondheim"
    answer = page.http.get(f"{page.url}/{shown['url']}", timeout=30)
    assert (answer.content, answer.headers["Content-Type"]) == (b"RIFF kept", "image/webp")
    for name in (stray, kept.upper(), kept[:-1], "x", f"{kept}%00"):
        assert page.http.get(f"{page.url}/crop/{name}.webp", timeout=30).status_code == 404


def test_sign_is_drawn_with_what_is_written_on_it(page: Browser) -> None:
    """Whatever is asked for is text in the drawing, never markup."""
    answer = page.http.get(f"{page.url}/sign/802.svg", params={"text": "<script>200 m"}, timeout=30)
    assert answer.headers["Content-Type"] == "image/svg+xml"
    assert "<script" not in answer.text


def test_page_speaks_norwegian(server: Server) -> None:
    """Verdict, reason, when it was seen, and every text of the page."""
    page = server(lang=Lang.NB)("kari")
    found = page.get(f"finding/{WRONG_TYPE}")
    assert found["seen_sentence"] == "Sett 10. juni 2026 av to kameraer."
    assert page.get("session")["messages"]["page.view.finding"] == "Funn"
    assert page.post("undo", {})[1]["error"] == "Det er ingenting igjen å angre i denne økten."


def test_dismissed_as_temporary_speaks_for_its_kind(page: Browser, store: Path) -> None:
    """The log says so; only a dismissal can be for that."""
    assert page.answer(NEW, "accept", temporary=True)[0] == 400
    assert page.answer(NEW, "dismiss", temporary=True)[0] == 200
    with Store.open(store) as opened:
        (entry,) = opened.rows(sa.select(schema.decision_log.c.cause))
    assert entry["cause"]["kind"] == "temporary"


def test_why_there_are_no_pictures_is_told_in_the_language_asked_for(
    page: Browser, store: Path, twin: Twin
) -> None:
    """Made of kind and facts when shown; what an older twin kept is a text alone, and stays as it was."""
    with Store.open(store) as opened, opened.transaction() as connection:
        connection.execute(sa.update(schema.annotation_set).values(folder="/gone"))
    on_terminal = twin("evidence", "--store", store, "--lang", "nb").err
    assert re.search("kan ikke leses, for mappen /gone er borte: .* [(]4 funn[)]\n0 av 4 funn", on_terminal)

    def told(accepted: str) -> str:
        page.http.headers["Accept-Language"] = accepted
        (gap,) = page.get(f"finding/{MOVED}")["gaps"]
        return str(gap)

    assert "for mappen /gone er borte: legg den tilbake" in told("nb")
    with Store.open(store) as opened:
        assert told("en") == gaps_of(opened.rows, MOVED)[0].sentence
        with opened.transaction() as connection:
            connection.execute(sa.update(schema.crop_gap).values(why=None, sentence="As it was told."))
    assert told("nb") == "As it was told."
