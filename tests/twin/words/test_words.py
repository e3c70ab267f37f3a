"""The table of messages, the names of signs, and the sentences that are made of kinds and facts."""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, get_args, get_type_hints

import msgspec
import pytest
from defusedxml.ElementTree import fromstring

from twin.belief import State
from twin.cli.belief import _OF_BITS, _OF_PLACES, _OF_ROADS
from twin.export.layers import COLUMNS
from twin.export.qgis.project import GROUPS, THEMES
from twin.reports.finding_list import FindingRow
from twin.store.kinds import Decision, JobState, Verdict
from twin.words import (
    Lang,
    language_from,
    messages,
    name_in,
    say,
    seen_sentence,
    sentence,
    sign_title,
    sign_titles,
    terms_in_words,
    why_from_json,
    why_to_json,
)
from twin.words import reasons as r
from twin.words.gaps import GAP_KEYS
from twin.words.sentences import KEYS
from twin.words.table import facts_of, table

TWIN = Path(__file__).parents[3] / "twin"
PAIR = r.Basis(1.1, r.CodesAgree.SAME, 2, (r.TextDiffers("808", "300 m", "200 m"),), True, False, 3)
SITE = r.SignSite(95, 17, ("142", "999"))
NAMES = {"142": "Barn"}


def kinds() -> Iterator[type[msgspec.Struct]]:
    """Every kind that a sentence is made of by its fields."""
    for union in (r.Why, r.Misfit, r.Difference):
        yield from get_args(union)
    yield from get_args(r.DriveDoubted)
    yield from GAP_KEYS


def named_in_code() -> set[str]:
    """Keys that the code names, and those that it makes from a kind, a verdict or a decision."""
    sources = [*TWIN.rglob("*.py"), *(path for path in TWIN.rglob("*.js") if "vendor" not in path.parts)]
    literal = {key for path in sources for key in re.findall(r"[\"'`]([a-z]+(?:\.\w+)+)", path.read_text())}
    families = {
        "verdict": Verdict,
        "decision": Decision,
        "reopened": Decision,
        "decide": Decision,
        # Opinions and their withdrawal come with second opinions.
        "entry": ["decided", "undone", "reopened", "carried", "opinion", "withdrawn", "suppressed", "lifted"],
        "alias": [f"{layer}.{one.name}" for layer, columns in COLUMNS.items() for one in columns],
        "qgis": list(qgis_names()),
        "opening": [f"layer.{layer}" for layer in COLUMNS],
        "match": ["change", "verdict", "decision", "road", "reason"],
        "explain": ["term", "value", "meaning", "at", "decision", "by", "how", "reason"],
        "explained": re.findall(r'"(\w+)": ', (TWIN / "cli/explain.py").read_text()),
        **dict.fromkeys(
            ("confidence", "status", "evaluate"),
            (*in_quotes("cli/reports.py"), *in_quotes("reports/survey_doubts.py"), *JobState),
        ),
        "show": in_quotes("cli/show.py"),
        "findings": [column.name for column in fields(FindingRow)],
        "belief": [
            *(f"column.{name}" for name in (*_OF_PLACES, *_OF_ROADS, *_OF_BITS)),
            *(f"state.{state.value}" for state in State),
        ],
        "basis": [f"codes_{one.value}" for one in r.CodesAgree],
    }
    made = {f"{family}.{name}" for family, names in families.items() for name in names}
    shown = {key.removesuffix(".label").removesuffix(".explanation") for key in table()}
    terms = {key for key in shown if key.startswith("term.")}
    told = {f"term.{name}" for name in in_quotes("words/terms.py")}
    told |= {f"term.odds_{name.removeprefix('term.')}" for name in told}
    parts = {f"{key}.{part}" for key in terms & told for part in ("label", "explanation")}
    return literal | made | {*KEYS.values(), *GAP_KEYS.values()} | parts


def in_quotes(module: str) -> list[str]:
    """Words that stand alone in quotes in a module of twin."""
    return re.findall(r'"(\w+)"', (TWIN / module).read_text())


def qgis_names() -> Iterator[str]:
    """Names that the QGIS project gives to groups, layers, themes, boxes of the form and legends."""
    yield from (f"group.{group}" for group in GROUPS)
    yield from (f"layer.{name}" for names in GROUPS.values() for name in names)
    yield from (f"theme.{theme}" for theme in THEMES)
    for file in (TWIN / "export/qgis/saved_styles").glob("*.qml"):
        root = fromstring(file.read_text("utf-8"))
        phrases = messages(Lang.EN, f"qgis.tip.{file.stem}.")
        yield from (
            key.removeprefix("qgis.") for key, one in phrases.items() if one in root.findtext("mapTip")
        )
        yield from (f"box.{box.get('name').lower()}" for box in root.iter("attributeEditorContainer"))
        yield from (f"legend.{file.stem}.{one.get('value') or 'other'}" for one in root.iter("category"))


def test_every_message_has_every_language_with_the_same_facts() -> None:
    """A translation that says less, or other facts, than the English text is found."""
    wrong = [
        key
        for key, texts in table().items()
        if set(texts) != set(Lang)
        or len({facts_of(text) - {"n"} for text in texts.values()}) != 1
        or not all(isinstance(text, str) or set(text) == {"one", "other"} for text in texts.values())
    ]
    assert wrong == []


def test_no_message_is_unused() -> None:
    """What no code says, nobody has to translate; the page's own texts are looked for in its modules."""
    assert {
        key for key in table() if not key.startswith(("page.", "annotate.", "live."))
    } - named_in_code() == set()


def test_message_of_a_kind_names_its_facts_alone() -> None:
    """A field that was renamed is missed here, not when a drive brings the first such finding."""
    unknown = {
        (kind.__name__, fact)
        for kind in set(kinds()) - {r.Told}
        for fact in facts_of(table()[{**KEYS, **GAP_KEYS}[kind]][Lang.EN]) - {*get_type_hints(kind), "n"}
    }
    assert unknown == set()


@pytest.mark.parametrize(
    ("why", "en", "nb"),
    [
        (
            r.Moved(SITE, 1234.567, 0.1, 1.0, PAIR),
            (
                "Skiltpunkt 17 (142 – Barn, 999) stands 1234.57 m (± 0.10 m) from NVDB's position, "
                "beyond the tolerance of 1.0 m (a distance of 1.1 sigmas, same sign codes, though 808 "
                'reads "300 m" and in NVDB "200 m", though NVDB says that it faces away, though on the '
                "other side, seen in 3 drives)."
            ),
            (
                "Skiltpunkt 17 (142 – Barn, 999) er flyttet: det står 1234,57 m (± 0,10 m) fra "
                "posisjonen i NVDB, mer enn toleransen på 1,0 m (avstand 1,1 standardavvik, samme "
                "skiltnumre, men 808 har teksten «300 m» og i NVDB «200 m», men etter ansiktssiden i "
                "NVDB vender det bort, men på den andre siden av vegen, sett i 3 kjøringer)."
            ),
        ),
        (
            r.Missing(r.SignSite(96, 18), 14, 1),
            (
                "Skiltplate 18 was not seen, though its place was in view in 14 frames of a completely "
                "annotated drive."
            ),
            (
                "Skiltplate 18 mangler: det ble ikke sett, selv om stedet var i synsfeltet i 14 bilder "
                "fra en fullstendig annotert kjøring."
            ),
        ),
        (
            r.Doubtful(
                r.DriveDoesNotFit("trip", (r.ClockOff(120.4), r.Told("an old text"))),
                "wrong_type",
                r.WrongType(18, "", "142"),
            ),
            (
                "The drive trip does not fit itself (its camera clock is 120 ms off; an old text): "
                "mend it and ingest it again. Else this would be wrong type: Skiltplate 18 is without "
                "a code in NVDB, but 142 – Barn was seen."
            ),
            (
                "Kjøringen trip stemmer ikke med seg selv (kameraklokken går 120 ms feil; an old "
                "text): rett den og les den inn på nytt. Ellers ville funnet vært «feil skilttype»: "
                "Skiltplate 18 har feil skilttype: i NVDB er den uten skiltnummer, men 142 – Barn ble "
                "sett."
            ),
        ),
        (
            r.Reopened(
                "dismiss",
                "2026-06-01T08:00:00Z",
                "kari",
                "road works",
                (r.VerdictChanged("moved", "new"), r.CodesSeenChanged((), ("142", "808")), r.NvdbMoved(2.5)),
            ),
            (
                "Dismissed 2026-06-01 by kari (road works); since then the verdict changed from moved "
                "to new, the sign code seen changed from none to 142;808, NVDB's position moved 2.50 m."
            ),
            (
                "Avvist 2026-06-01 av kari (road works); siden da har funnet gått fra «er flyttet» til "
                "«står ikke i NVDB», er skiltnummeret som ble sett, endret fra ingen til 142;808, er "
                "posisjonen i NVDB flyttet 2,50 m."
            ),
        ),
    ],
    ids=["moved", "missing", "doubtful", "reopened"],
)
def test_sentence_is_made_in_the_language_asked_for(why: r.Sayable, en: str, nb: str) -> None:
    """Facts, names of signs and numbers stand in both, written as each language writes them."""
    assert sentence(why, Lang.EN, NAMES) == en
    assert sentence(why, Lang.NB, NAMES) == nb


def test_reason_comes_back_from_the_store_as_it_was() -> None:
    """A reason within a reason, with misfits of several kinds, through JSON."""
    misfits = (r.CameraTurned("C1", 4.5), r.CamerasDisagree(), r.Told("an old text"))
    why = r.Doubtful(r.DriveDoesNotFit("trip", misfits), "moved", r.UnsureOfSite(SITE, 0.6, SITE, PAIR))
    assert why_from_json(msgspec.json.decode(msgspec.json.encode(why_to_json(why)))) == why


@pytest.mark.parametrize(
    ("verdi", "named"),
    [
        ("362.50 - Fartsgrense, 50 km/t", ("362.50", "Fartsgrense, 50 km/t")),
        ("906V - Hindermarkering, hinder til venstre", ("906V", "Hindermarkering, hinder til venstre")),
        ("U722.2 - Vegviser for vegkryss", ("U722.2", "Vegviser for vegkryss")),
        ("362.50", None),
        ("Ukjent", None),
    ],
)
def test_name_of_a_sign_is_what_nvdb_writes_behind_its_code(
    verdi: str, named: tuple[str, str] | None
) -> None:
    """The code alone has no name, and none is guessed."""
    assert name_in(verdi) == named


def test_sign_without_a_name_is_its_code() -> None:
    """Also beside one that has a name, and of a pole without plates nothing is said."""
    assert sign_title("142", NAMES) == "142 – Barn"
    assert sign_titles(("142", "808"), NAMES) == "142 – Barn + 808"
    assert sign_titles((), NAMES) == ""


@dataclass
class Sight:
    """What `seen_sentence` and `terms_in_words` need of a finding."""

    terms: dict[str, Any]
    cameras: tuple[str, ...] = ("C1", "C2")
    drive_ids: tuple[str, ...] = ("a",)
    days: tuple[dt.date, ...] = field(default=())


@pytest.mark.parametrize(
    ("sight", "en", "nb"),
    [
        (
            Sight({"seen": {"first": "2026-06-12T08:00:00Z", "last": "2026-06-12T08:00:03Z"}}),
            "Seen 12 June 2026 by two cameras.",
            "Sett 12. juni 2026 av to kameraer.",
        ),
        (
            Sight(
                {"seen": {"first": "2026-06-12T08:00:00Z", "last": "2026-07-01T08:00:03Z"}},
                cameras=("C1",),
                drive_ids=("a", "b"),
            ),
            "Seen from 12 June 2026 to 1 July 2026 by one camera in two drives.",
            "Sett fra 12. juni 2026 til 1. juli 2026 av ett kamera i to kjøringer.",
        ),
        (
            Sight({"absence": {"frames": 14, "gone": 0.9}}, days=(dt.date(2026, 6, 12),)),
            "Not seen 12 June 2026 by two cameras. Its place was in view in 14 pictures.",
            "Ikke sett 12. juni 2026 av to kameraer. Stedet var i synsfeltet i 14 bilder.",
        ),
        (Sight({"seen": {"first": None}}), "Seen by two cameras.", "Sett av to kameraer."),
    ],
)
def test_when_and_by_whom_a_sign_was_seen_comes_first(sight: Sight, en: str, nb: str) -> None:
    """Days, cameras and drives in words; a day that is not known is left out."""
    assert seen_sentence(sight, Lang.EN, sight.days) == en
    assert seen_sentence(sight, Lang.NB, sight.days) == nb


def test_terms_have_a_label_and_say_what_they_weigh() -> None:
    """Those that the finding has, with the language's decimal sign; the poles' keys and ids are no terms."""
    sight = Sight({"log_odds": {"position": 9.4}, "match": 0.9991, "pole": "key", "texts": []})
    assert [(term.label, term.value) for term in terms_in_words(sight, Lang.NB)] == [
        ("posisjon", "+9,40"),
        ("riktig par", "99,9\N{NO-BREAK SPACE}%"),
    ]


def test_page_gets_its_messages_with_one_and_several_apart() -> None:
    """What depends on a number comes as two texts, for the page to choose from."""
    got = messages(Lang.NB, "seen.")
    assert got["seen.cameras.one"] == "ett kamera"
    assert got["seen.on"] == "{first:day}"


@pytest.mark.parametrize(
    ("accepted", "lang"),
    [
        ("nb-NO,nb;q=0.9,en;q=0.8", Lang.NB),
        ("nn_NO.UTF-8", Lang.NB),
        ("sv,en;q=0.7", Lang.EN),
        ("", Lang.EN),
    ],
)
def test_language_is_the_first_one_that_twin_speaks(accepted: str, lang: Lang) -> None:
    """Norwegian of any kind is Bokmål; whoever asks for nothing that twin speaks gets English."""
    assert language_from(accepted) is lang


def test_unknown_message_and_missing_fact_are_faults() -> None:
    """Neither is guessed."""
    with pytest.raises(KeyError):
        say(Lang.EN, "seen.nowhere")
    with pytest.raises(KeyError):
        say(Lang.EN, "seen.cameras")
