"""A sink that blocks loses lines, counted, what lasts last; nobody waits for it, and it is told of."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path
from threading import Thread

from live_lines import estimate
from live_senders import until

from twin.live.estimates import State
from twin.live.outlets import Outlet
from twin.live.sinks import Lines


def test_a_pipe_that_nobody_reads_loses_lines_and_no_final_one() -> None:
    """Saying a thousand lines takes no time; read again, finals come first, and what was lost is known."""
    ours, theirs = os.pipe()
    with os.fdopen(ours) as reader, os.fdopen(theirs, "wb", 0) as stream:
        outlet = Outlet(Lines(stream), most=50)
        until(lambda: (outlet.say(estimate("R", State.REFINED, "x" * 4000)), outlet.state.blocked)[1])
        began_s = time.monotonic()
        for i in range(1000):
            outlet.say(estimate(f"R{i}", State.REFINED))
        for i in range(10):
            outlet.say(estimate(f"R{990 + i}", State.FINAL))
        assert time.monotonic() - began_s < 5.0
        assert outlet.state.lost >= 1000 - 50
        found: list[tuple[str, str]] = []
        while len(found) < 10 or found[-1][1] != "refined":
            one = json.loads(reader.readline())
            if one["id"] != "R":
                found.append((one["id"], one["properties"]["state"]))
        assert found[:10] == [(f"R{990 + i}", "final") for i in range(10)]
        assert found[10][0] not in {name for name, _ in found[:10]}
        Thread(target=reader.read, daemon=True).start()
        outlet.close(10.0)
        assert not outlet.state.blocked


def test_a_sink_that_has_ended_is_left_alone(tmp_path: Path) -> None:
    """Its error is kept, and what is said to it costs nothing."""
    stream = (tmp_path / "lines").open("wb", 0)
    outlet = Outlet(Lines(stream))
    stream.close()
    outlet.say(estimate("P1", State.FINAL))
    until(lambda: outlet.state.ended)
    assert isinstance(outlet.error, ValueError)
    for _ in range(5000):
        outlet.say(estimate("P1", State.FINAL))
    outlet.close(5.0)
