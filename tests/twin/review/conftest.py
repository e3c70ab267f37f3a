"""The review page's server on a copy of the sample's store."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from review_browser import Browser, Open, browser_of, served

from twin.store.store import Store


@pytest.fixture
def server(store: Path) -> Iterator[Callable[..., Open]]:
    """Start the page on the test's store; what comes back opens browsers on it."""
    with ExitStack() as stack:

        def start(path: Path = store, **options: Any) -> Open:
            opened = stack.enter_context(Store.open(path, create=False))
            address, token = stack.enter_context(served(opened, **options))
            return partial(browser_of, address, token)

        yield start


@pytest.fixture
def page(server: Callable[..., Open]) -> Browser:
    """Kari's browser."""
    return server()("kari")
