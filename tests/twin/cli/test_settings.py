"""``twin.toml``: what is set once, in which order it holds, and how a wrong key is told."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from checkout import ROOT
from command_line import Twin
from typer.main import get_group

from nvdb.replay import ReplayServer
from twin.cli.app import app
from twin.cli.settings import SETTINGS


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's own folder of settings; the test runs in a folder without a store."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "home"))
    work = tmp_path / "work"
    work.mkdir()
    monkeypatch.chdir(work)
    folder = tmp_path / "home" / "twin"
    folder.mkdir(parents=True)
    return folder


def held(twin: Twin, key: str, *options: object) -> tuple[object, str, str | None]:
    """Value, source and place of a setting, as ``twin config --json`` tells them."""
    answer = twin("config", "--json", *options)
    one = next(one for one in answer.json["settings"] if one["key"] == key)
    return one["value"], one["source"], one["where"]


def test_option_stands_above_environment_above_store_above_user_above_default(
    twin: Twin, home: Path, store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each layer hides the one below: in what `config` says, and in the language that a command speaks."""
    titles = {"en": "Store ", "nb": "Lager "}

    def spoken(*options: object) -> str:
        out = twin("status", "--store", store, *options).out
        return next(lang for lang, title in titles.items() if out.startswith(title))

    beside, users = store.parent / "twin.toml", home / "twin.toml"
    assert (held(twin, "lang", "--store", store), spoken()) == (("en", "default", None), "en")
    users.write_text('lang = "nb"\n', encoding="utf-8")
    assert (held(twin, "lang", "--store", store), spoken()) == (("nb", "file", str(users)), "nb")
    beside.write_text('lang = "en"\n', encoding="utf-8")
    assert (held(twin, "lang", "--store", store), spoken()) == (("en", "file", str(beside)), "en")
    monkeypatch.setenv("TWIN_LANG", "nb")
    assert (held(twin, "lang", "--store", store), spoken()) == (("nb", "environment", "TWIN_LANG"), "nb")
    assert spoken("--lang", "en") == "en"


def test_store_and_its_own_file_are_found_through_the_users_file(twin: Twin, home: Path, store: Path) -> None:
    """The user's file names the store, and the file beside that store counts too."""
    (home / "twin.toml").write_text(f"store = {json.dumps(str(store))}\n", encoding="utf-8")
    (store.parent / "twin.toml").write_text('by = "kari"\n', encoding="utf-8")
    assert twin("status", "--json").json["store"] == str(store)
    assert held(twin, "by") == ("kari", "file", str(store.parent / "twin.toml"))


def test_sync_needs_no_options_where_a_file_has_them(
    twin: Twin, home: Path, sample: Path, tmp_path: Path
) -> None:
    """Area, contact, address and road network come from the file; an area that is typed hides the file's."""
    with ReplayServer(sample / "nvdb") as server:
        (tmp_path / "work" / "twin.toml").write_text(
            f'kommune = [5001]\ncontact = "kari@kommune.no"\nvegnett = true\napi_url = "{server.url}"\n',
            encoding="utf-8",
        )
        assert twin("sync-nvdb").code == 0
        assert any("vegnett" in asked.path for asked in server.requests)
        assert {asked.headers["X-Kontaktperson"] for asked in server.requests} == {"kari@kommune.no"}
        assert twin("status", "--json").json["mirror"]["area"] == "kommune 5001"
        n_asked = len(server.requests)
        assert "mirrors kommune 5001, not fylke 50" in twin("sync-nvdb", "--fylke", "50").err
        assert twin("sync-nvdb", "--no-vegnett").code == 0
        assert not any("vegnett" in asked.path for asked in server.requests[n_asked:])


def test_paths_in_a_file_are_taken_from_its_folder(twin: Twin, home: Path, sample: Path, store: Path) -> None:
    """A path means the same wherever the command is started."""
    (store.parent / "twin.toml").write_text('labels = "labels/ours.toml"\n', encoding="utf-8")
    answer = twin("ingest-drive", sample / "trip_trondheim", "--store", store)
    assert (answer.code, str(store.parent / "labels" / "ours.toml") in answer.err) == (4, True)


WRONG = {
    'lnag = "nb"': "has the key lnag, which twin does not know (perhaps lang)",
    'lang = "fr"': "sets lang to fr: write one of en, nb.",
    "lang = 3": "sets lang to 3: write a text in quotes.",
    'vegnett = "yes"': "sets vegnett to 'yes': write true or false.",
    'detector_every = "often"': "sets detector_every to 'often': write a number.",
    "detector_every = 0": "sets detector_every to 0: write a whole number of at least 1.",
    'store = "x.db"': "sets store, which only the user's own file can",
    'skriv_password = "hemmelig"': "keep API Skriv's password in the environment as TWIN_SKRIV_PASSWORD",
    "lang = nb": "are no TOML",
    "kommune = 0301": 'also a number that begins with 0 ("0301")',
    "kommune = 5001,5031": "several values in brackets ([5001, 5031])",
    'labels = "C:\\Users\\kari"': "a path has / instead of \\;",
    "vegnett = ja": "yes is true",
}


@pytest.mark.parametrize("text", WRONG)
def test_wrong_settings_are_one_sentence_with_file_and_cure(
    twin: Twin, home: Path, store: Path, sample: Path, text: str
) -> None:
    """A misspelt key does not pass unseen, and what is secret is not repeated."""
    path = store.parent / "twin.toml"
    path.write_text(text, encoding="utf-8")
    line = ["ingest-drive", sample / "trip_trondheim"] if "detector" in text else ["status"]
    answer = twin(*line, "--store", store)
    assert (answer.code, answer.out) == (2, "")
    assert str(path) in answer.err
    assert WRONG[text] in answer.err
    assert answer.err.count("\n") == 1
    assert "hemmelig" not in answer.err
    assert twin("status", "--help").code == 0
    if "detector_every = 0" not in text and "fr" not in text:
        shown = twin("config", "--store", store)
        assert (shown.code, WRONG[text] in shown.err, "detector_every" in shown.out) == (0, True, True)
    (home / "twin.toml").write_text(text, encoding="utf-8")
    assert "twin.toml" in twin("help", "config").out


@pytest.mark.parametrize(
    ("text", "command", "told"),
    [
        ('lang = "fr"', "config", "sets lang to fr: write one of en, nb."),
        ('method = "best"', "config", "sets method to best: write one of"),
        ("detector_every = 0", "config", "sets detector_every to 0: write a whole number of at least 1."),
        ('kommune = "Oslo"', "config", "sets kommune to Oslo. "),
        ('kommune = "Oslo"', "sync-nvdb", "sets kommune to Oslo. "),
        ("bbox = [1, 2, 3]", "config", "sets bbox to 1,2,3. "),
    ],
)
def test_a_wrong_value_is_told_with_its_file(
    twin: Twin, home: Path, store: Path, text: str, command: str, told: str
) -> None:
    """`twin config` checks a file as the commands do that take its values."""
    path = store.parent / "twin.toml"
    path.write_text(text, encoding="utf-8")
    answer = twin(command, "--store", store)
    assert (answer.code, f"{path} {told}" in answer.err, answer.err.count("\n")) == (2, True, 1), answer.err


def test_a_file_of_notepad_is_read(twin: Twin, home: Path, store: Path) -> None:
    """A byte-order mark is no fault; another encoding is told, with the cure."""
    path = store.parent / "twin.toml"
    path.write_bytes(b'\xef\xbb\xbfby = "K\xc3\xa5re"\r\n')
    assert held(twin, "by", "--store", store)[0] == "K\u00e5re"
    path.write_bytes('by = "K\u00e5re"'.encode("cp1252"))
    answer = twin("status", "--store", store)
    assert (answer.code, f"{path} are not in UTF-8: save the file as UTF-8" in answer.err) == (2, True)


def test_config_shows_no_secret(twin: Twin, home: Path, store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether a password is set is said, what it is is not; nor what an address holds of users and tokens."""
    monkeypatch.setenv("TWIN_SKRIV_PASSWORD", "hemmelig")
    monkeypatch.setenv("TWIN_SKRIV_URL", "https://kari:hysjhysj@skriv.no/x?token=abcabc")
    for options in ((), ("--json",)):
        out = twin("config", "--store", store, *options).out
        assert "skriv.no" in out
        assert not {"hemmelig", "hysjhysj", "abcabc"} & set(re.findall(r"\w+", out))
    assert twin("config", "--store", store, "--json").json["password"]["is_set"]


def test_every_key_stands_for_an_option() -> None:
    """No key of the table is without effect: some command takes its variable."""
    variables = {parameter.envvar for command in _commands(get_group(app)) for parameter in command.params}
    assert [one.key for one in SETTINGS if one.variable not in variables] == []


def _commands(group: Any) -> Iterator[Any]:
    yield group
    for name in group.list_commands(None):
        command = group.get_command(None, name)
        yield from _commands(command) if hasattr(command, "list_commands") else [command]


def test_documentation_lists_every_key() -> None:
    """docs/config.md has each key with its variable, in the order of the code."""
    text = (ROOT / "docs" / "config.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\| `(\w+)` \| (.+?) \| `(\w+)` \| (.+?) \|$", text, flags=re.MULTILINE)
    assert listed == [(one.key, one.kind.value, one.variable, one.what) for one in SETTINGS]
