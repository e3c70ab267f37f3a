"""A bounded queue: what matters least is lost first and counted, and whoever waits loses nothing."""

from __future__ import annotations

from threading import Thread

from hypothesis import given
from hypothesis import strategies as st

from twin.live.lanes import Lanes


@given(st.lists(st.one_of(st.integers(0, 2), st.none()), max_size=60), st.integers(1, 6), st.booleans())
def test_never_more_than_its_size_and_nothing_uncounted(
    steps: list[int | None], most: int, overtakes: bool
) -> None:
    """What was put is got, held, or counted as lost; in each lane in the order in which it came."""
    queue: Lanes[tuple[int, int]] = Lanes(3, most, overtakes=overtakes)
    put, got = [0, 0, 0], []
    for number, lane in enumerate(steps):
        if lane is None:
            one = queue.get(0.0)
            got += [one] if one is not None else []
        else:
            queue.put((number, lane), lane)
            put[lane] += 1
        assert len(queue) <= most
    got += queue.drained()
    for lane in range(3):
        mine = [number for number, its in got if its == lane]
        assert mine == sorted(mine)
        assert len(mine) + queue.lost[lane] == put[lane]


def test_the_last_lane_loses_its_oldest_first() -> None:
    """Frames before fixes."""
    queue: Lanes[str] = Lanes(2, 3)
    for name, lane in (
        ("frame 1", 1),
        ("fix 1", 0),
        ("frame 2", 1),
        ("fix 2", 0),
        ("fix 3", 0),
        ("fix 4", 0),
    ):
        queue.put(name, lane)
    assert list(queue.drained()) == ["fix 2", "fix 3", "fix 4"]
    assert queue.lost == [1, 2]


def test_what_matters_more_overtakes_where_that_is_asked_for() -> None:
    """Finals go before what later lines replace."""
    queue: Lanes[str] = Lanes(2, 10, overtakes=True)
    for name, lane in (("refined", 1), ("final", 0)):
        queue.put(name, lane)
    queue.drop(lambda one: one == "nothing", 1)
    assert list(queue.drained()) == ["final", "refined"]


def test_whoever_waits_loses_nothing_until_it_is_hurried() -> None:
    """A thread that puts a thousand into a queue of three gets all of them through, in order."""
    queue: Lanes[int] = Lanes(2, 3)

    def put_all() -> None:
        for i in range(1000):
            queue.put(i, i % 2, waits=True)
        queue.close()

    thread = Thread(target=put_all, daemon=True)
    thread.start()
    found = []
    while (one := queue.get()) is not None:
        found.append(one)
    thread.join(30.0)
    assert found == list(range(1000))
    full: Lanes[int] = Lanes(1, 1)
    full.put(0, 0)
    waiting = Thread(target=lambda: full.put(1, 0, waits=True), daemon=True)
    waiting.start()
    full.hurry()
    waiting.join(30.0)
    assert not waiting.is_alive()
    assert full.lost == [1]
