"""``twin submit``: change sets to API Skriv."""

from __future__ import annotations

import importlib
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from twin.cli.exit_codes import EXIT_DATA
from twin.cli.journal import PASSWORD
from twin.cli.options import (
    DEFAULT_SKRIV_API,
    DEFAULT_STORE,
    ContactOption,
    JsonOption,
    SkrivApiOption,
    StoreOption,
)
from twin.cli.output import note, print_json, print_table, steps, warn
from twin.errors import ConfigError, RefusedError
from twin.store.address import StoreAddress

if TYPE_CHECKING:
    from nvdb.skriv import SkrivClient
    from twin.changesets.submit import Submitted

app = typer.Typer()
_KEYRING = "twin API Skriv"

Credentials = Callable[[], tuple[str, str]]


class Realm(StrEnum):
    """Kinds of users of API Skriv, as in :data:`nvdb.skriv.login.Realm`."""

    EMPLOYEE = "EMPLOYEE"
    SERVICE_ACCOUNT = "SERVICE_ACCOUNT"
    EXTERNAL = "EXTERNAL"


@app.command("submit", epilog="Example: twin submit out  (checks only)   then: twin submit out --go")
def submit(
    path: Annotated[
        Path, typer.Argument(help="An export's folder, or one change set.", metavar="FOLDER|FILE")
    ],
    go: Annotated[
        bool, typer.Option("--go", help="Send and start them; without it they are checked.")
    ] = False,
    api_url: SkrivApiOption = DEFAULT_SKRIV_API,
    contact: ContactOption = None,
    user: Annotated[
        str | None,
        typer.Option(envvar="TWIN_SKRIV_USER", help="User name; the password is TWIN_SKRIV_PASSWORD's."),
    ] = None,
    realm: Annotated[
        Realm, typer.Option(envvar="TWIN_SKRIV_REALM", help="What kind of user that is.")
    ] = Realm.EMPLOYEE,
    wait: Annotated[float, typer.Option(min=0, help="Longest wait for one set.", metavar="SECONDS")] = 3600.0,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Check the change sets of an export; with --go send them to NVDB's API Skriv and report each object.

    The store remembers what was sent: nothing goes to NVDB twice.
    """
    from nvdb.errors import LoginError

    credentials = _credentials(user)
    if go and credentials is None:
        raise ConfigError(
            f"Sending needs a user and a password: set TWIN_SKRIV_USER and {PASSWORD}, or keep the password "
            f"in the keyring under {_KEYRING!r}."
        )
    done: list[Submitted] = []
    try:
        api = _Api(api_url, contact, realm, wait)
        for item in _results(path, store if go else None, credentials, api, quiet=json_output):
            done.append(item)  # noqa: PERF402  # what has ended is kept where a later one fails
    except BaseException as error:
        # What was carried out is told, whatever went wrong after it.
        if done:
            _print(done, go, credentials is not None, json_output)
        if isinstance(error, LoginError):
            raise RefusedError(str(error)) from error
        raise
    _print(done, go, credentials is not None, json_output)
    if not all(item.accepted for item in done):
        raise typer.Exit(EXIT_DATA)


@dataclass(frozen=True, slots=True)
class _Api:
    """Which API Skriv, as what kind of user, and how long to wait for a set."""

    url: str
    contact: str | None
    realm: Realm
    wait_s: float


def _results(
    path: Path, store: StoreAddress | None, credentials: Credentials | None, api: _Api, *, quiet: bool
) -> Iterator[Submitted]:
    """Send sets from a store, or check them where none is given, and yield each when it has ended."""
    from twin.changesets.read_exported import exported_sets
    from twin.changesets.submit import checked
    from twin.changesets.submit import submit as send
    from twin.store.store import Store

    if credentials is None:
        yield from (checked(item) for item in exported_sets(path))
    elif store is None:
        exported = exported_sets(path)
        with steps(quiet=quiet) as say, _client(api, credentials, say) as client:
            yield from (checked(item, client) for item in exported)
    else:
        with (
            Store.open(store, create=False) as opened,
            steps(quiet=quiet) as say,
            _client(api, credentials, say) as client,
        ):
            yield from send(path, opened, client, api_url=api.url, timeout_s=api.wait_s, say=say)


@contextmanager
def _client(api: _Api, credentials: Credentials, say: Callable[[str], None]) -> Iterator[SkrivClient]:
    from nvdb import NvdbClient
    from nvdb.skriv import OidcLogin, SkrivClient

    def wait(seconds: float) -> None:
        say(f"the set is being worked on: asking again in {seconds:.0f} s")
        time.sleep(seconds)

    with NvdbClient(api.url, contact=api.contact) as http:
        yield SkrivClient(http, OidcLogin(http, credentials, realm=api.realm.value), sleep=wait)


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
