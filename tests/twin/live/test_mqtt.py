"""Lines to an MQTT broker: whole, in order, and none that lasts is lost where the broker is restarted."""

from __future__ import annotations

import itertools
import json
import time
from collections.abc import Callable

import pytest
from live_lines import estimate
from mqtt_broker import Broker

from twin.errors import ConfigError
from twin.live.estimates import State
from twin.live.outlets import Outlet
from twin.live.sinks import Mqtt


def names(broker: Broker) -> list[str]:
    """Of what was published."""
    return [json.loads(payload)["id"] for _, payload in broker.published]


def until(what: Callable[[], object], patience_s: float = 30.0) -> None:
    """Wait until something holds."""
    end_s = time.monotonic() + patience_s
    while not what():
        assert time.monotonic() < end_s
        time.sleep(0.02)


def test_what_lasts_survives_a_broker_that_is_restarted() -> None:
    """Sent until the broker has it: while there is none it waits, and lines of the past are replaced."""
    with Broker() as first:
        sink = Outlet(Mqtt(f"mqtt://127.0.0.1:{first.port}/car/7"))
        for i in range(20):
            sink.say(estimate(f"P{i}", State.FINAL))
        until(lambda: len(first.published) == 20)
        assert names(first) == [f"P{i}" for i in range(20)]
        assert {topic for topic, _ in first.published} == {"car/7"}
    for i in range(20, 40):
        sink.say(estimate(f"P{i}", State.FINAL))
    with Broker(first.port) as second:
        until(lambda: {f"P{i}" for i in range(20, 40)} <= set(names(second)))
        sink.close(10.0)
        assert sink.state.lost == 0


@pytest.mark.slow
def test_a_broker_that_reads_nothing_costs_lines_and_no_memory() -> None:
    """The queue is bounded: the oldest of what is replaced is lost, and counted; nothing that lasts."""
    with Broker() as broker:
        sink = Outlet(Mqtt(f"mqtt://127.0.0.1:{broker.port}/car"), most=50)
        sink.say(estimate("first", State.FINAL))
        until(lambda: broker.published)
        broker.reads.clear()
        numbers = itertools.count()

        def is_blocked() -> bool:
            sink.say(estimate(f"R{next(numbers) % 100}", State.REFINED, label="x" * 200_000))
            return sink.state.blocked

        until(is_blocked)
        for i in range(100):
            sink.say(estimate(f"R{i}", State.REFINED))
        sink.say(estimate("last", State.FINAL))
        assert sink.state.lost >= 50
        broker.reads.set()
        until(lambda: "last" in names(broker))
        sink.close(10.0)


def test_a_topic_with_wildcards_is_refused() -> None:
    """Nobody can send to many topics at once."""
    with pytest.raises(ConfigError, match="no topic to send to"):
        Mqtt("mqtt://127.0.0.1:1/car/#")
