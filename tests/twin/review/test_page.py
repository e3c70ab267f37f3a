"""The review page, used in a browser by keyboard."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect
from review_browser import served
from review_page import (
    LAPTOP,
    TABLET,
    UPRIGHT,
    chromium,
    free_port,
    log_of,
    open_page,
    press,
    put_findings,
    running,
    shown,
)

from twin.store.store import Store

NO_WEBGL = """
const real = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
  return kind.startsWith("webgl") ? null : real.call(this, kind, ...more);
};
"""
CHECKS = Path(__file__).parents[2].joinpath("page_checks.js").read_text("utf-8")


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """One browser for all tests."""
    with chromium() as one:
        yield one


@pytest.fixture
def context(browser: Browser) -> Iterator[BrowserContext]:
    """A person's browser, without anything in its storage."""
    with browser.new_context(viewport=LAPTOP, locale="en-GB") as one:
        yield one


@pytest.fixture
def plain(context: BrowserContext) -> BrowserContext:
    """One without WebGL, for tests that are not about the map: drawing it is most of what a finding costs."""
    return without_map(context)


def without_map(context: BrowserContext) -> BrowserContext:
    """Take WebGL from a browser: the page says so in place of the map."""
    context.add_init_script(NO_WEBGL)
    return context


@pytest.fixture
def address(store: Path) -> Iterator[Callable[..., str]]:
    """Serve the page on the test's store; returns the address that opens it."""
    with ExitStack() as stack:

        def start(**options: Any) -> str:
            opened = stack.enter_context(Store.open(store, create=False))
            where, token = stack.enter_context(served(opened, **options))
            return where.url(token)

        yield start


def test_a_finding_is_settled_by_one_key(
    address: Callable[..., str], plain: BrowserContext, store: Path
) -> None:
    """The answer is in the log by the person's name, and the next finding is there."""
    page = open_page(plain, address(), "Kari Nordmann")
    first = shown(page)
    press(page, "a")
    expect(page.locator("#answers .answer.accept")).to_be_enabled()
    assert shown(page) != first
    expect(page.locator("#said")).to_contain_text("Accepted")
    wait_until_sent(page)
    assert log_of(store) == [(first, "accept", "Kari Nordmann", "")]


def test_comment_undo_and_typing(address: Callable[..., str], plain: BrowserContext, store: Path) -> None:
    """Shift asks for a comment, in which bare letters are letters; undo leads back to the first question."""
    page = open_page(plain, address(person="kari"))
    first = shown(page)
    page.keyboard.press("Shift+D")
    expect(page.locator("#comment")).to_be_focused()
    page.keyboard.type("a dead sign, behind a hedge")
    assert shown(page) == first
    press(page, "Enter")
    second = shown(page)
    press(page, "s")
    third = shown(page)
    for question in (second, first):
        press(page, "u")
        assert shown(page) == question
    assert third not in (first, second)
    wait_until_sent(page)
    assert [(one, decision, why) for one, decision, _, why in log_of(store)][:2] == [
        (first, "dismiss", "a dead sign, behind a hedge"),
        (second, "defer", ""),
    ]
    page.keyboard.press("u")
    expect(page.locator(".notice")).to_contain_text("take back")


@pytest.mark.slow
def test_a_hundred_findings_by_keyboard_alone(
    address: Callable[..., str], plain: BrowserContext, store: Path
) -> None:
    """Each key settles the finding that was on the screen; none comes twice."""
    put_findings(store, 100)
    page = open_page(plain, address(person="kari"))
    given = []
    for at in range(100):
        given.append((shown(page), ("accept", "dismiss", "defer")[at % 3]))
        press(page, "ads"[at % 3])
    expect(page.locator(".end h1")).to_be_visible()
    wait_until_sent(page)
    assert [(one, decision) for one, decision, _, _ in log_of(store)] == given
    assert len({one for one, _ in given}) == 100


def test_a_sign_of_road_works_is_dismissed_by_its_own_key(
    address: Callable[..., str], plain: BrowserContext, store: Path
) -> None:
    """Only a sign that NVDB lacks can be one: elsewhere the key does nothing."""
    put_findings(store, 2)
    page = open_page(plain, address(person="kari"))
    for _ in range(2):
        before, verdict = shown(page), page.evaluate("window.twinReview.finding.verdict")
        if verdict == "new":
            press(page, "t")
            new = before
        else:
            page.keyboard.press("t")
            page.wait_for_timeout(300)
            assert shown(page) == before
            press(page, "j" if page.evaluate("window.twinReview.queue.left") == 2 else "s")
    wait_until_sent(page)
    assert (new, "dismiss") in {entry[:2] for entry in log_of(store)}


@pytest.mark.slow
def test_a_key_that_is_held_answers_once(address: Callable[..., str], plain: BrowserContext) -> None:
    """What is pressed too long must not answer findings that nobody has looked at."""
    page = open_page(plain, address(person="kari"))
    first = shown(page)
    page.keyboard.down("a")
    for _ in range(5):
        page.keyboard.down("a")  # Chromium is told of a held key in this way: the event repeats.
    page.keyboard.up("a")
    expect(page.locator(f'#finding[data-change-id="{first}"]')).to_have_count(0)
    wait_until_sent(page)
    page.keyboard.press("h")
    expect(page.locator(".answers-given li")).to_have_count(1)


def test_no_request_leaves_the_machine(address: Callable[..., str], context: BrowserContext) -> None:
    """Every view is opened, and every request goes to the server that the page came from."""
    url = address(person="kari")
    origin = url.partition("/?")[0]
    asked: list[str] = []
    context.on("request", lambda request: asked.append(request.url))
    errors: list[str] = []
    context.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
    page = open_page(context, url)
    expect(page.locator("#map")).to_have_attribute("data-shown", shown(page))
    for key in ("?", "h", "f", "l", "m"):
        page.keyboard.press(key)
    expect(page.locator(".whole")).to_have_attribute("data-shown", re.compile(r"\d+"))
    page.keyboard.press("Escape")
    page.keyboard.press("Escape")
    press(page, "a")
    wait_until_sent(page)
    outside = [one for one in asked if not one.startswith((origin, "blob:", "data:"))]
    assert outside == []
    assert errors == []
    assert any("maplibre-gl-worker.mjs" in one for one in asked)


@pytest.mark.slow
def test_two_tabs_show_what_the_other_answered(
    address: Callable[..., str], plain: BrowserContext, store: Path
) -> None:
    """Another answer from a tab that is behind is refused in a sentence; its comment is kept."""
    url = address(person="kari")
    one, other = open_page(plain, url), open_page(plain, url)
    first = shown(one)
    assert shown(other) == first
    press(one, "a")
    wait_until_sent(one)
    other.fill("#comment", "it is gone")
    other.locator("#comment").blur()
    press(other, "d")
    notice = other.locator(".notice")
    expect(notice).to_be_visible()
    notice.get_by_role("button").first.click()
    expect(other.locator("#finding")).to_have_attribute("data-change-id", first)
    expect(other.locator(".about .state")).to_have_class(re.compile("accept"))
    expect(other.locator("#comment")).to_have_value("it is gone")
    assert [entry[:2] for entry in log_of(store)] == [(first, "accept")]


@pytest.mark.slow
def test_two_reviewers_at_once_are_both_kept(
    address: Callable[..., str], browser: Browser, store: Path
) -> None:
    """Each in a browser of their own, blind: both opinions stand, and nobody saw the other's."""
    url = address(blind=True)
    with browser.new_context() as hers, browser.new_context() as his:
        kari, ola = (open_page(without_map(c), url, name) for c, name in ((hers, "Kari"), (his, "Ola")))
        first = shown(kari)
        assert shown(ola) == first
        expect(kari.locator(".mode.blind")).to_be_visible()
        press(kari, "a")
        wait_until_sent(kari)
        ola.reload()
        expect(ola.locator("#finding")).to_have_attribute("data-change-id", first)
        assert "Kari" not in ola.locator("#why").inner_text()
        press(ola, "d")
        wait_until_sent(ola)
    assert {(one, decision, by) for one, decision, by, _ in log_of(store)} >= {
        (first, "accept", "Kari"),
        (first, "dismiss", "Ola"),
    }


def test_who_may_only_look_cannot_answer(
    address: Callable[..., str], plain: BrowserContext, store: Path
) -> None:
    """The page says that it is read-only, and keys of answers do nothing."""
    page = open_page(plain, address(read_only=True))
    first = shown(page)
    expect(page.locator(".mode.read-only")).to_be_visible()
    expect(page.locator(".answer")).to_have_count(0)
    page.keyboard.press("a")
    page.keyboard.press("j")
    expect(page.locator(f'#finding[data-change-id="{first}"]')).to_have_count(0)
    assert log_of(store) == []


@pytest.mark.slow
def test_answers_outlive_the_server(plain: BrowserContext, store: Path) -> None:
    """Killed between two answers: those given meanwhile are kept, told, and sent once to the next server."""
    findings, port = put_findings(store, 12), free_port()
    with running(store, port) as (process, url):
        page = open_page(plain, url, "Kari")
        given = [shown(page)]
        press(page, "a")
        wait_until_sent(page)
        # The page fetches the findings to come ahead: without a server it goes on as far as it has.
        page.wait_for_load_state("networkidle")
        process.kill()
        process.wait()
        for _ in range(2):
            given.append(shown(page))
            press(page, "d")
        expect(page.locator(".notice.lost")).to_have_attribute("data-pending", "2")
    with running(store, port) as (_, url):
        # The next server knows neither this browser nor its person: the new address opens the door.
        again = open_page(plain, url, "Kari")
        wait_until_sent(again)
        expect(page.locator(".notice.lost")).to_have_count(0)
        given.append(shown(again))
        press(again, "s")
        wait_until_sent(again)
    assert [entry[:3] for entry in log_of(store)] == [
        (given[0], "accept", "Kari"),
        (given[1], "dismiss", "Kari"),
        (given[2], "dismiss", "Kari"),
        (given[3], "defer", "Kari"),
    ]
    assert len(set(given)) == 4
    assert set(given) <= set(findings)


@pytest.mark.slow
def test_kept_answers_stay_their_givers(plain: BrowserContext, store: Path) -> None:
    """What one left at a stopped server is sent by that one's name; who comes next answers by their own."""
    put_findings(store, 4)
    port = free_port()
    with running(store, port) as (process, url):
        page = open_page(plain, url, "Kari")
        page.wait_for_load_state("networkidle")
        process.kill()
        process.wait()
        press(page, "a")
        expect(page.locator(".notice.lost")).to_have_attribute("data-pending", "1")
        page.close()
    with running(store, port, "--by", "Ola") as (_, url):
        again = open_page(plain, url)
        wait_until_sent(again)
        expect(again.locator("#progress .numbers")).to_contain_text("1 of ")
        press(again, "d")
        wait_until_sent(again)
        expect(again.locator("#progress .numbers")).to_contain_text("2 of ")
        press(again, "u")
        expect(again.locator("#progress .numbers")).to_contain_text("1 of ")
    assert [entry[1:3] for entry in log_of(store)] == [
        ("accept", "Kari"),
        ("dismiss", "Ola"),
        ("open", "Ola"),
    ]


def test_the_list_counts_what_was_answered(
    address: Callable[..., str], plain: BrowserContext, store: Path
) -> None:
    """After all are answered the list says how many there were."""
    put_findings(store, 3)
    page = open_page(plain, address(), "Kari")
    total = page.evaluate("window.twinReview.queue.total")
    for _ in range(total):
        press(page, "a")
    wait_until_sent(page)
    press(page, "l")
    expect(page.locator("#list")).to_contain_text(f"{total} of {total}")


@pytest.mark.slow
def test_pictures_map_and_views_by_keyboard(address: Callable[..., str], context: BrowserContext) -> None:
    """Browsing settles nothing; list, map and panels open and close by their keys; the address leads back."""
    page = open_page(context, address(person="kari"))
    first = shown(page)
    press(page, "j")
    second = shown(page)
    press(page, "k")
    assert shown(page) == first
    page.keyboard.press("l")
    expect(page.locator("#list tbody tr")).to_have_count(4)
    page.locator(f'#list a[data-id="{second}"]').press("Enter")
    expect(page.locator("#finding")).to_have_attribute("data-change-id", second)
    page.reload()
    expect(page.locator("#finding")).to_have_attribute("data-change-id", second)
    page.go_back()
    expect(page.locator("#list")).to_be_visible()
    page.keyboard.press("?")
    expect(page.locator("#help")).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.locator("#help")).to_be_hidden()


@pytest.mark.slow
def test_single_keys_can_be_switched_off(address: Callable[..., str], plain: BrowserContext) -> None:
    """Who speaks to the computer needs that (WCAG 2.1.4)."""
    page = open_page(plain, address(person="kari"))
    first = shown(page)
    page.locator("#open-help").click()
    page.locator("#keys-on").uncheck()
    page.keyboard.press("Escape")
    page.keyboard.press("a")
    page.wait_for_timeout(300)
    assert shown(page) == first
    page.locator(".answer.accept").press("Enter")
    expect(page.locator(f'#finding[data-change-id="{first}"]')).to_have_count(0)


@pytest.mark.parametrize(
    ("viewport", "scheme"),
    [
        pytest.param(LAPTOP, "light", id="laptop"),
        pytest.param(LAPTOP, "dark", id="laptop-dark", marks=pytest.mark.slow),
        pytest.param(TABLET, "dark", id="tablet-dark"),
        pytest.param(UPRIGHT, "light", id="upright", marks=pytest.mark.slow),
    ],
)
def test_page_can_be_read_and_reached(
    address: Callable[..., str], browser: Browser, scheme: Any, viewport: Any
) -> None:
    """WCAG AA: contrast of all text, names of all controls, a visible focus on each, nothing cut off."""
    with browser.new_context(viewport=viewport, color_scheme=scheme, reduced_motion="reduce") as context:
        page = open_page(context, address(person="kari"))
        expect(page.locator("#map")).to_have_attribute("data-shown", shown(page))
        for key in ("", "?", "f", "l"):
            if key:
                page.keyboard.press(key)
                page.wait_for_timeout(150)
            assert page.evaluate(CHECKS, "weak") == [], key
            assert page.evaluate(CHECKS, "nameless") == [], key
        page.keyboard.press("l")
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        for name in ("accept", "dismiss", "defer"):
            button = page.locator(f".answer.{name}")
            expect(button).to_be_in_viewport(ratio=1)
            box = button.bounding_box()
            assert box is not None
            assert min(box["width"], box["height"]) >= 44
        walked = walk(page)
        assert {"accept", "dismiss", "defer"} <= {one["kind"] for one in walked}
        assert [one for one in walked if not one["isOutlined"]] == []


def walk(page: Page) -> list[dict[str, Any]]:
    """Press Tab until all controls of the page have had the focus; what each showed."""
    page.evaluate("document.activeElement.blur()")
    seen: list[dict[str, Any]] = []
    for _ in range(60):
        page.keyboard.press("Tab")
        one = page.evaluate(CHECKS, "focused")
        if one is None:
            break
        seen.append(one)
    return seen


@pytest.mark.slow
def test_every_text_is_in_the_language_of_the_browser(address: Callable[..., str], browser: Browser) -> None:
    """No key of the table shows through, and the document says its language."""
    url = address(person="kari")
    for locale, lang, word in (("nb-NO", "nb", "Godta"), ("en-GB", "en", "Accept")):
        with browser.new_context(locale=locale) as context:
            page = open_page(context, url)
            assert page.locator("html").get_attribute("lang") == lang
            for key in ("?", "h", "f", "l", "m"):
                page.keyboard.press(key)
            text = page.locator("body").evaluate("body => body.innerHTML")
            assert word in text
            assert not re.search(r"page\.[a-z]", re.sub(r'data-say(-label)?="[^"]*"', "", text))


def wait_until_sent(page: Page) -> None:
    """Until the server has answered everything."""
    page.wait_for_timeout(20)
    for _ in range(600):
        if page.evaluate("window.twinReview.outbox.pending.length") == 0:
            return
        page.wait_for_timeout(100)
    pytest.fail("answers were not sent within a minute")
