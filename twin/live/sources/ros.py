"""ROS 2: topics of a recording that is played, and live ones where ROS is installed.

Positions are NavSatFix, as in recorded drives. Detections are texts (``std_msgs/String``) of JSON lines. A
message goes on as the line that a recorder keeps of it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from threading import Event
from typing import Any

from twin.drives.folder.files import DriveFolder
from twin.drives.track.fixes import LeftOutError
from twin.drives.track.formats.gpsd import report_of
from twin.drives.track.formats.recording import Recording
from twin.drives.track.formats.rosbag import fix_of, messages_of, paths_of, recorded_topics
from twin.errors import ConfigError
from twin.live.events import Arrival
from twin.live.ports import Trouble, TroubleKind
from twin.live.replay import played
from twin.live.sources.decoders import Decoder
from twin.live.sources.epochs import Epochs
from twin.live.sources.links import Connection, Piece

TEXT_TYPE = "std_msgs/msg/String"
_ONLY = 0

ToLines = Callable[[Any, int], bytes]
"""A message, and when it came → lines for its decoder; raises LeftOutError for what is none."""


def fix_lines(message: Any, at_ns: int) -> bytes:
    """Write a NavSatFix as reports of gpsd."""
    return report_of(fix_of(message, at_ns))


def text_lines(message: Any, _at_ns: int) -> bytes:
    """Write the text of a String message, a frame a line."""
    return str(message.data).encode() + b"\n"


def topic_of(there: Mapping[str, str], kind: str, wanted: str | None, name: str) -> str:
    """Choose the topic of a type: the one that is named, else the only one.

    Raises
    ------
    ConfigError
        If there is none, or several and none is named.
    """
    fitting = sorted(topic for topic, its in there.items() if its == kind)
    if wanted in fitting:
        return str(wanted)
    if wanted is None and len(fitting) == 1:
        return fitting[0]
    listed = ", ".join(fitting) or f"none; its topics are {', '.join(sorted(there)[:8]) or 'none at all'}"
    missing = f"no topic {wanted}" if wanted else "not one topic alone"
    raise ConfigError(f"{name} has {missing} of {kind}: name one with ?topic=… (it has {listed}).")


class PlayedSource:
    """A topic of a recording, as if it came now: arrivals have the stamps of the recorder.

    Parameters
    ----------
    name : str
    path : Path
        A file, or the folder of a ROS 2 recording.
    kind : str
        Type of the topic.
    topic : str or None
    to_lines : callable
    decoder : Decoder
    speed : float or None
        Times as fast; None: as fast as it goes.

    Raises
    ------
    ConfigError, DriveError
        If it is no sound recording, or it is not clear which topic is meant.
    """

    def __init__(
        self,
        name: str,
        path: Path,
        kind: str,
        topic: str | None,
        to_lines: ToLines,
        decoder: Decoder,
        speed: float | None,
    ) -> None:
        self._name, self._decoder, self._to_lines, self._speed = name, decoder, to_lines, speed
        self._paths = paths_of(Recording(DriveFolder(path.parent), path.name))
        self._topic = topic_of(recorded_topics(self._paths, path.name), kind, topic, name)
        self._stopped, self._epochs = Event(), Epochs(name)

    @property
    def name(self) -> str:
        """Return its address."""
        return self._name

    def close(self) -> None:
        """End `arrivals`, from another thread."""
        self._stopped.set()

    def arrivals(self) -> Iterator[Arrival | Trouble]:
        """Yield what the topic holds, at its pace; return at its end."""
        faults: Counter[str] = Counter()
        last_ns = 0
        for arrival in played(self._recorded(faults), self._speed, sleep=self._sleep):
            if self._stopped.is_set():
                return
            last_ns = arrival.at_ns
            yield from self._epochs.checked(arrival)
        count = faults.total() + self._decoder.unreadable
        for why, number in self._decoder.refused.items():
            yield Trouble(last_ns, self._name, TroubleKind.REFUSED, number, why)
        if count:
            yield Trouble(
                last_ns, self._name, TroubleKind.GARBAGE, count, next(iter(faults), self._decoder.why)
            )

    def _recorded(self, faults: Counter[str]) -> Iterator[Arrival]:
        at_ns = 0
        for at_ns, message in messages_of(self._paths, self._name, [self._topic], faults):
            try:
                lines = self._to_lines(message, at_ns)
            except LeftOutError as reason:
                faults[str(reason)] += 1
                continue
            yield from (Arrival(at_ns, what) for what in self._decoder.feed(lines, at_ns))
            # A message is whole.
            yield from (Arrival(at_ns, what) for what in self._decoder.pause())

    def _sleep(self, seconds: float) -> None:
        self._stopped.wait(seconds)


@dataclass(frozen=True, slots=True)
class Ros2Link:
    """A live topic, by rclpy, which comes with ROS 2 and not from PyPI.

    Raises
    ------
    ConfigError
        If it is not there.
    """

    topic: str
    is_position: bool
    ends: bool = False
    asks_again: bool = False

    def __post_init__(self) -> None:
        if find_spec("rclpy") is None:
            raise ConfigError(
                f"The live topic {self.topic} needs rclpy, which this Python does not have: start twin in a"
                " shell in which ROS 2 is set up (source /opt/ros/…/setup.bash), or play a recording,"
                " mcap:///path."
            )

    def open(self, _stopped: Event) -> Connection:
        """Subscribe, as a node of its own."""
        return _Node(self.topic, is_position=self.is_position)


class _Node:
    def __init__(self, topic: str, *, is_position: bool) -> None:
        from importlib import import_module

        rclpy = import_module("rclpy")
        kind: Any = import_module("sensor_msgs.msg").NavSatFix if is_position else None
        if kind is None:
            kind = import_module("std_msgs.msg").String
        self._pieces: list[Piece] = []
        self._to_lines: ToLines = fix_lines if is_position else text_lines
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self._node = rclpy.create_node("twin_live", context=self._context)
        qos = import_module("rclpy.qos").qos_profile_sensor_data
        self._node.create_subscription(kind, topic, self._take, qos)
        self._executor = import_module("rclpy.executors").SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)

    def read(self, patience_s: float) -> list[Piece]:
        self._executor.spin_once(timeout_sec=patience_s)
        pieces, self._pieces = self._pieces, []
        return pieces

    def close(self) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def _take(self, message: Any) -> None:
        try:
            lines = self._to_lines(message, 0)
        except LeftOutError:
            return  # no fix, by its status
        self._pieces.append(Piece(_ONLY, lines))
