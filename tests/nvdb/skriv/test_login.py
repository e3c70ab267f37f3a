"""Logins of API Skriv: tokens that end, wrong passwords, and what must never be shown or sent."""

from __future__ import annotations

import logging
from contextlib import ExitStack
from datetime import timedelta
from pathlib import Path

import pytest
from skriv_desk import PASSWORD, Desk, correction

from nvdb.client import NvdbClient
from nvdb.errors import (
    LoginError,
    RequestError,
)
from nvdb.skriv import SKRIV_URL, OidcLogin, SkrivClient


def test_one_login_serves_until_its_token_ends(desk: Desk) -> None:
    """The token is used until a minute before its end, then renewed without the password."""
    desk.client.submit(correction())
    assert (desk.logins, desk.asked("/authenticate"), desk.asked("/refresh")) == (1, 1, 0)
    desk.now += timedelta(seconds=850)
    desk.client.validate(correction())
    assert (desk.logins, desk.asked("/refresh")) == (1, 1)


def test_a_token_that_the_server_does_not_know_is_named(desk: Desk) -> None:
    """401 says to log in again."""
    desk.login()
    desk.server.end_tokens()
    with pytest.raises(LoginError, match=r"401.*log in again") as error:
        desk.client.validate(correction())
    assert error.value.status == 401


def test_a_user_without_the_role_is_told_so(stack: ExitStack) -> None:
    """403 says whom to ask."""
    desk = Desk(stack, roles=False)
    with pytest.raises(LoginError, match=r"403.*ask the road authority"):
        desk.client.validate(correction())


def test_a_wrong_password_is_named(desk: Desk) -> None:
    """The documented empty object becomes an error that names neither user nor password."""
    login = OidcLogin(desk.http, lambda: ("olanor", "wrong-word"))
    with pytest.raises(LoginError, match="does not take this user name and password") as error:
        login()
    assert "wrong-word" not in str(error.value) + repr(login)


def test_a_login_at_a_wrong_address_is_named(desk: Desk) -> None:
    """An address without a login says so, with its status."""
    with NvdbClient(f"{desk.server.url}/elsewhere") as http:
        login = OidcLogin(http, lambda: ("olanor", PASSWORD))
        with pytest.raises(LoginError, match="answered 404: check the API URL"):
            login()


def test_tokens_and_passwords_are_never_logged_or_shown(desk: Desk, caplog: pytest.LogCaptureFixture) -> None:
    """Neither the log at its finest, nor what the client looks like, holds them."""
    caplog.set_level(logging.DEBUG)
    desk.server.lose.append("/validator")
    desk.client.submit(correction())
    seen = caplog.text + repr(desk.login) + repr(desk.client) + repr(vars(desk.client))
    assert "/start" in seen
    assert PASSWORD not in seen
    assert desk.login() not in seen


def test_a_netrc_does_not_replace_the_token(
    desk: Desk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file of passwords on the machine has no say in what is sent."""
    netrc = tmp_path / "netrc"
    netrc.write_text("machine 127.0.0.1 login someone password other\n", encoding="utf-8")
    monkeypatch.setenv("NETRC", str(netrc))
    desk.http._session.trust_env = True
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    assert desk.client.submit(correction()).accepted


@pytest.mark.parametrize("token", ["", "a b", "a\r\nX-Evil: 1", "é"])
def test_a_token_that_could_change_the_request_is_refused(desk: Desk, token: str) -> None:
    """Only printable ASCII without spaces goes into the header."""
    client = SkrivClient(desk.http, lambda: token)
    with pytest.raises(RequestError, match="id token is empty or holds characters"):
        client.progress("abc")


def test_a_login_does_not_go_over_an_open_line() -> None:
    """Plain http is for this machine alone."""
    http = NvdbClient(SKRIV_URL.replace("https", "http"))
    with http, pytest.raises(RequestError, match="over https only"):
        SkrivClient(http, lambda: "t")
    with http, pytest.raises(RequestError, match="over https only"):
        OidcLogin(http, lambda: ("olanor", PASSWORD))
