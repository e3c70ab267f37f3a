"""Many tests look at the same pictures: what is found in one is worked out once."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from matplotlib.layout_engine import ConstrainedLayoutEngine

import twin.calibrate.extrinsics.calibrate as of_rigs
import twin.calibrate.intrinsics.calibrate as of_lenses


def _once(find: Callable[..., Any]) -> Callable[..., Any]:
    """What `find` finds in each picture with the same other arguments, kept."""
    kept: dict[tuple[str, str], Any] = {}

    def found(image: np.ndarray, *more: Any) -> Any:
        at = hashlib.sha256(image.tobytes()).hexdigest(), repr((image.shape, *more))
        if at not in kept:
            kept[at] = find(image, *more)
        return kept[at]

    return found


@pytest.fixture(scope="session", autouse=True)
def each_picture_once() -> Iterator[None]:
    """Boards and tags of a picture are looked for by the real detectors, the first time that it is seen."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(of_lenses, "detect", _once(of_lenses.detect))
        patch.setattr(of_rigs, "detect", _once(of_rigs.detect))
        patch.setattr(of_rigs, "find_tags", _once(of_rigs.find_tags))
        yield


@pytest.fixture
def unarranged(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are drawn, but not arranged: half of their time, of which tests of numbers see nothing."""
    monkeypatch.setattr(ConstrainedLayoutEngine, "execute", lambda _engine, _figure: None)
