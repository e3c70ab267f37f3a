"""The body of ``twin submit``, and what ``twin export`` says of change sets."""

from __future__ import annotations

import importlib
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

from twin.cli.output import note, print_json, print_table, steps, warn
from twin.errors import ConfigError, RefusedError

if TYPE_CHECKING:
    from nvdb.skriv.client import SkrivClient
    from twin.changesets import ChangeSets
    from twin.changesets.read_exported import ExportedSet
    from twin.changesets.submit import Submitted

PASSWORD = "TWIN_SKRIV_PASSWORD"  # noqa: S105  (the name of a variable)
_KEYRING = "twin API Skriv"
_EXIT_DATA = 4
"""What API Skriv or our own checks refuse, as :data:`twin.cli.EXIT_DATA`."""
_CONTACT = "TWIN_CONTACT"

Realm = Literal["EMPLOYEE", "SERVICE_ACCOUNT", "EXTERNAL"]
Credentials = Callable[[], tuple[str, str]]


def print_change_sets(made: ChangeSets, folder: Path) -> None:
    """Say what became of the findings: sets, warnings, what was left out."""
    for item in made.left_out:
        warn(item.sentence)
    for number, sett in enumerate(made.setts, start=1):
        for sentence in sett.warnings:
            note(f"set {number}: {sentence}")
        for sentence in sett.errors:
            warn(f"set {number} is not written: {sentence}")
        for clause in sett.not_undone:
            note(f"set {number} cannot be undone by twin: {clause}.")
    n = sum(len(sett.groups) for sett in made.setts if not sett.errors)
    if n and made.is_preview:
        note(f"Previews of change sets: they cannot be sent, since nobody has accepted these findings ({n}).")
    elif n:
        note(f"Check the change sets with `twin submit {folder}`, send them with --go.")


def change_sets_as_json(made: ChangeSets) -> dict[str, Any]:
    """The same for programs."""
    return {
        "errors": [sentence for sett in made.setts for sentence in sett.errors],
        "left_out": {item.change_id: item.sentence for item in made.left_out},
    }


def end_if_unsendable(made: ChangeSets) -> None:
    """End with the exit code for bad data where a set has errors."""
    if any(sett.errors for sett in made.setts):
        raise typer.Exit(_EXIT_DATA)


def submit(
    path: Path, go: bool, api_url: str, user: str | None, realm: Realm, wait_s: float, json_output: bool
) -> None:
    """``twin submit``."""
    from nvdb.errors import LoginError
    from twin.changesets.read_exported import exported_sets

    found = exported_sets(path)
    credentials = _credentials(user)
    if go and credentials is None:
        raise ConfigError(
            f"Sending needs a user and a password: set TWIN_SKRIV_USER and {PASSWORD}, or keep the password "
            f"in the keyring under {_KEYRING!r}."
        )
    done: list[Submitted] = []
    try:
        _do(found, credentials, go, _Api(api_url, realm, wait_s), done, quiet=json_output)
    except LoginError as error:
        raise RefusedError(str(error)) from error
    finally:
        # What was carried out is told, whatever went wrong after it.
        _print(done, go, credentials is not None, json_output)
    if not all(item.accepted for item in done):
        raise typer.Exit(_EXIT_DATA)


@dataclass(frozen=True, slots=True)
class _Api:
    """Which API Skriv, as what kind of user, and how long to wait for a set."""

    url: str
    realm: Realm
    wait_s: float


def _do(
    found: Sequence[ExportedSet],
    credentials: Credentials | None,
    go: bool,
    api: _Api,
    done: list[Submitted],
    *,
    quiet: bool,
) -> None:
    """Check or send the sets; each is added to `done` when it has ended."""
    from twin.changesets.receipts import Receipts
    from twin.changesets.submit import checked, not_done, sent

    if credentials is None:
        done += [checked(item) for item in found]
        return
    with steps(quiet=quiet) as say, _client(api, credentials, say) as client:
        if not go:
            done += [checked(item, client) for item in found]
            return
        receipts = {folder: Receipts(folder, api.url) for folder in {item.path.parent for item in found}}
        for item in not_done(found, receipts):
            done.append(sent(item, client, receipts[item.path.parent], timeout_s=api.wait_s, say=say))


@contextmanager
def _client(api: _Api, credentials: Credentials, say: Callable[[str], None]) -> Iterator[SkrivClient]:
    from nvdb import NvdbClient
    from nvdb.skriv.client import SkrivClient
    from nvdb.skriv.login import OidcLogin

    def wait(seconds: float) -> None:
        say(f"the set is being worked on: asking again in {seconds:.0f} s")
        time.sleep(seconds)

    with NvdbClient(api.url, contact=os.environ.get(_CONTACT)) as http:
        yield SkrivClient(http, OidcLogin(http, credentials, realm=api.realm), sleep=wait)


def _credentials(user: str | None) -> Credentials | None:
    """User and password from the environment, or from a keyring that happens to be installed."""
    if not user:
        return None
    password = os.environ.get(PASSWORD) or _from_keyring(user)
    return (lambda: (user, password)) if password else None


def _from_keyring(user: str) -> str | None:
    try:
        keyring: Any = importlib.import_module("keyring")
    except ImportError:
        return None
    password: str | None = keyring.get_password(_KEYRING, user)
    return password


def _print(done: Sequence[Submitted], go: bool, asked: bool, json_output: bool) -> None:
    if json_output:
        print_json({"sent": go, "sets": [asdict(item) for item in done]})
        return
    for item in done:
        where = f", change set {item.set_id}" if item.set_id else ""
        rows = [(o["operation"], str(o["nvdb_id"] or "new"), o["version"], o["result"]) for o in item.objects]
        print_table(f"{item.file}{where}", ["operation", "NVDB id", "version", "result"], rows, right_from=4)
        for sentence in item.sentences:
            note(sentence)
        if item.undo:
            note(f"{item.undo} undoes it: `twin submit` takes it like any other set.")
    refused = sum(not item.accepted for item in done)
    if refused:
        warn(f"Refused: {refused} of {len(done)}. Nothing of what is refused is in NVDB.")
    elif done and not go:
        how = "API Skriv's validator" if asked else "our own checks (give a user for API Skriv's validator)"
        what = "1 change set passes" if len(done) == 1 else f"{len(done)} change sets pass"
        note(f"{what} {how}; nothing was sent. Send with --go.")
