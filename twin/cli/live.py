"""``twin live``: positions while a drive goes on."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from twin.cli.drives import DetectorEveryOption, DetectorOption, DetectorThresholdOption
from twin.cli.endings import ended_in_order
from twin.cli.options import DEFAULT_STORE, StoreOption
from twin.cli.output import note, steps, warn
from twin.cli.pages import PageLangOption
from twin.cli.streams import unbuffered_output
from twin.errors import ConfigError, FileError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from twin.drives.detection.run import DetectorOptions
    from twin.live import LiveEngine
    from twin.live.check import LiveCheck
    from twin.live.notices import Notice
    from twin.live.ports import Sink, Source
    from twin.live.recorder import Recorder
    from twin.live.run import LiveRun
    from twin.live.sinks import Pages
    from twin.store.store import Store
    from twin.words import Lang

app = typer.Typer()

_FASTEST = "max"
_KEEP = "live.gpkg"
_LOOK_S = 0.1
_USUAL_S, _OFTEN_S = 1.0, 0.25
"""How often the car's state is said; on a map it moves."""
_EXAMPLE = "twin live --replay path/to/trip --speed max > live.geojsonl"


@app.command("live", epilog=f"Example: {_EXAMPLE}")
def live(
    replay: Annotated[
        Path | None,
        typer.Option(
            help="Play a recorded drive, as if it went on now.", metavar="DRIVE", show_default=False
        ),
    ] = None,
    gnss: Annotated[
        list[str] | None,
        typer.Option(
            help="Where fixes come from: NMEA over serial, TCP, UDP; SBP; gpsd; MCAP; ROS 2 (twin help live);"
            " several times for several antennas.",
            metavar="URL",
            show_default=False,
        ),
    ] = None,
    detections: Annotated[
        list[str] | None,
        typer.Option(
            help="Where detections come from: JSON lines over TCP, UDP, MQTT, or - for standard input; or a"
            " camera or video, with --detector.",
            metavar="URL",
            show_default=False,
        ),
    ] = None,
    car: Annotated[
        Path | None,
        typer.Option(
            help="The car: a folder with drive.toml and rig, as a drive's.",
            metavar="FOLDER",
            show_default=False,
        ),
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option(
            help="Record all that arrives into this new folder, which twin ingest-drive reads.",
            metavar="FOLDER",
            show_default=False,
        ),
    ] = None,
    keep: Annotated[
        Path | None,
        typer.Option(
            help="Add what is final to this GeoPackage, every second.  [default: live.gpkg beside the"
            " recording, if there is one]",
            metavar="FILE",
            show_default=False,
        ),
    ] = None,
    detector: DetectorOption = None,
    detector_every: DetectorEveryOption = 1,
    detector_threshold: DetectorThresholdOption = 0.25,
    to: Annotated[
        list[str] | None,
        typer.Option(
            help="Send the lines to an MQTT broker too: mqtt://HOST/TOPIC.", metavar="URL", show_default=False
        ),
    ] = None,
    serve: Annotated[
        str | None,
        typer.Option(
            help="Show the drive on a map in browsers. Any host but 127.0.0.1 lets other machines in.",
            metavar="HOST:PORT",
            show_default=False,
        ),
    ] = None,
    check: Annotated[
        bool, typer.Option("--check/--no-check", help="Hold what is seen against NVDB's signs in the store.")
    ] = False,
    store: StoreOption = DEFAULT_STORE,
    settings: Annotated[
        Path | None,
        typer.Option(
            envvar="TWIN_MATCH_SETTINGS",
            help="Settings of the check, as twin match has them: the table \\[matching] of a TOML file.",
            metavar="FILE.toml",
            show_default=False,
        ),
    ] = None,
    base_map: Annotated[
        bool,
        typer.Option(
            "--base-map/--no-base-map",
            envvar="TWIN_BASE_MAP",
            help="Let browsers show Kartverket's map, which they ask the internet for.",
        ),
    ] = False,
    lang: PageLangOption = None,
    speed: Annotated[
        str,
        typer.Option(
            help="Times as fast as it was driven; max: as fast as it goes. The estimates are the same.",
            metavar="FACTOR",
        ),
    ] = "1",
    every: Annotated[
        bool,
        typer.Option(
            "--every/--final",
            help="On stdout every estimate as it changes, and how the car does, or final estimates alone.",
        ),
    ] = True,
) -> None:
    """Locate signs as they are seen: one GeoJSON feature a line on stdout, with its error ellipse.

    An object is located from the first frame that shows it, refined while it is in view, and final when it
    has been out of view for a few seconds: the property state says which. Ctrl-C ends it in order: what is
    open becomes final. More: twin help live.
    """
    from twin.drives.detection.run import DetectorOptions
    from twin.store.store import Store

    network = None if detector is None else DetectorOptions(detector, detector_every, detector_threshold)
    _check_all(
        partial(_check_kind, replay, gnss, detections, car, record, detector),
        *_checks_of_addresses(gnss or [], detections or [], to or [], has_detector=detector is not None),
        partial(_factor, speed),
        *([] if serve is None else [partial(_host_and_port, serve)]),
    )
    with ExitStack() as stack:
        if replay is not None:
            drive = _replayed(replay, speed)
        else:
            drive = _connected(gnss or [], detections or [], car, record, network)
        opened = stack.enter_context(Store.open(store, create=False)) if check else None
        checked = None if opened is None else _check(stack, opened, drive, settings)
        sinks = _sinks(to or [], final=not every)
        if check and not every:
            warn("With --final no verdict of --check goes to standard output: --keep FILE keeps them.")
        if serve is not None:
            sinks.append(_pages(serve, drive, opened, lang, base_map=base_map))
        kept = keep or (None if record is None else record / _KEEP)
        if drive.recorder is not None:
            stack.enter_context(drive.recorder)
        _run(drive, sinks, kept, checked, is_shown=serve is not None)


def _check_all(*checks: Callable[[], object]) -> None:
    """Look at all that can be known by the command line alone, and tell every mistake at once."""
    mistakes = []
    for check in checks:
        try:
            check()
        except ConfigError as error:
            mistakes.append(str(error))
    if mistakes:
        raise ConfigError(" ".join(mistakes))


def _check_kind(
    replay: Path | None,
    gnss: Sequence[str] | None,
    detections: Sequence[str] | None,
    car: Path | None,
    record: Path | None,
    detector: Path | None,
) -> None:
    """A recorded drive, or a car's sources, and not both."""
    if replay is None and (not gnss or car is None):
        raise ConfigError(
            "twin live needs a drive: a recorded one (--replay DRIVE), or what a car delivers now (--gnss"
            " URL, --detections URL and --car FOLDER)."
        )
    if replay is not None and any((gnss, detections, car, record, detector)):
        raise ConfigError(
            "--replay plays a recorded drive with its annotations: leave out --gnss, --detections, --car,"
            " --record, --detector."
        )


def _checks_of_addresses(
    gnss: Sequence[str], detections: Sequence[str], to: Sequence[str], *, has_detector: bool
) -> list[Callable[[], object]]:
    from twin.live.sources.address import MQTT_SCHEMES, Gives, address_for, address_of

    return [
        *(partial(address_for, url, Gives.FIXES, has_detector=has_detector) for url in gnss),
        *(partial(address_for, url, Gives.DETECTIONS, has_detector=has_detector) for url in detections),
        *(partial(address_of, url, MQTT_SCHEMES) for url in to),
    ]


class _Drive(NamedTuple):
    """What is run: an engine that nothing has been fed to, and what feeds it."""

    name: str
    engine: LiveEngine
    sources: Sequence[Source]
    is_recorded: bool
    is_complete: bool
    """Whether frames come with every sign that they show."""
    recorder: Recorder | None = None


def _replayed(path: Path, speed: str) -> _Drive:
    from twin.drives.read import read_drive
    from twin.live import LiveEngine, Replay, car_of

    factor = _factor(speed)
    with steps(quiet=False) as say:
        drive = read_drive(path, progress=say)
    for warning in drive.warnings:
        warn(str(warning))
    engine = LiveEngine(car_of(drive))
    return _Drive(str(path), engine, [Replay(drive, factor)], True, drive.annotations_complete)


def _connected(
    gnss: Sequence[str],
    detections: Sequence[str],
    car: Path | None,
    record: Path | None,
    detector: DetectorOptions | None,
) -> _Drive:
    from twin.live import LiveEngine
    from twin.live.car import antennas_of, read_car
    from twin.live.recorder import Recorder
    from twin.live.sources import Gives, open_source

    assert car is not None  # noqa: S101 - looked at before
    whose = read_car(car)
    for warning in whose.warnings:
        warn(str(warning))
    if not detections:
        warn("Nothing looks for signs without --detections: the car alone is followed.")
    engine = LiveEngine(whose.live_car(antennas_of(whose, gnss)))
    recorder = None if record is None else Recorder(record, whose)
    asked = [(url, Gives.FIXES) for url in gnss] + [(url, Gives.DETECTIONS) for url in detections]
    sources = [open_source(url, gives, whose, recorder=recorder, detector=detector) for url, gives in asked]
    settings = whose.settings
    if settings.annotations_complete and not settings.detections_complete:
        warn(
            f"{car} says annotations_complete = true, which is of people: what a detector finds counts as"
            " complete only with detections_complete = true, so no sign is called missing."
        )
    return _Drive(str(car), engine, sources, False, settings.detections_complete, recorder)


def _check(stack: ExitStack, store: Store, drive: _Drive, settings: Path | None) -> LiveCheck:
    from twin.live.check import LiveCheck, MirrorAhead
    from twin.matching.config import MatchConfig, settings_from

    config = MatchConfig() if settings is None else settings_from(settings)
    ahead = MirrorAhead(store, config)
    stack.callback(ahead.close)
    return LiveCheck(drive.engine, ahead, is_complete=drive.is_complete, config=config)


def _sinks(to: Sequence[str], *, final: bool) -> list[Sink]:
    from twin.live.sinks import Lines, Mqtt

    sinks: list[Sink] = [Lines(unbuffered_output(), final=final)]
    return sinks + [Mqtt(url) for url in to]


def _pages(serve: str, drive: _Drive, store: Store | None, lang: Lang | None, *, base_map: bool) -> Pages:
    from twin.live.sinks import Pages
    from twin.live.sinks.session import session_route
    from twin.mirror.names import shipped_names, sign_names
    from twin.web import Outside, listening
    from twin.web.base_map import HOST

    names = shipped_names() if store is None else sign_names(store)
    listener, address = listening(*_host_and_port(serve))
    if not address.is_loopback:
        warn(f"Other machines can reach this page at {address.host}; whoever has its address may use it.")
    outside = Outside((HOST,) if base_map else ())
    route = session_route(drive.engine.car, names, lang=lang, base_map=base_map)
    pages = Pages(listener, address, outside, [route])
    # Not a note, which hides what opens doors.
    sys.stderr.write(f"The drive is shown at {pages.url}\n")
    sys.stderr.flush()
    return pages


def _run(
    drive: _Drive, sinks: Sequence[Sink], keep: Path | None, check: LiveCheck | None, *, is_shown: bool
) -> None:
    from twin.live.keep import Keeper
    from twin.live.run import LiveRun, RunSettings

    keeper = None if keep is None else Keeper(keep, drive.name)
    run = LiveRun(
        drive.engine,
        drive.sources,
        sinks,
        keeper=keeper,
        check=check,
        recording=drive.recorder,
        tell=_tell,
        settings=RunSettings(waits=drive.is_recorded, state_every_s=_OFTEN_S if is_shown else _USUAL_S),
    )
    run.start()
    with ended_in_order() as asked:
        while not run.wait(_LOOK_S):
            # Whoever read standard output has left, and nobody else is there to hear.
            if asked.is_set() or (keeper is None and run.is_unheard):
                run.stop()
    _tell_the_end(run)


def _tell(notice: Notice) -> None:
    (warn if notice.is_bad else note)(notice.sentence())


def _tell_the_end(run: LiveRun) -> None:
    engine, last = run.engine, run.last
    if run.is_unheard and last.keep is None:
        raise run.errors[0]
    lost = f"; {run.lost} objects got no position" if run.lost else ""
    dropped = f"; {last.frames_dropped} frames were left out" if last.frames_dropped else ""
    note(f"{engine.frames} frames, {engine.sightings} sightings, {run.final} objects located{lost}{dropped}.")
    if not run.whole and last.keep is not None:
        raise FileError(
            f"{last.keep.name} could not be written at the end: {last.keep.waiting} final estimates and"
            " verdicts are not in it. Free space on its disk, or end the program that holds it."
        )


def _factor(speed: str) -> float | None:
    if speed == _FASTEST:
        return None
    try:
        factor = float(speed)
    except ValueError:
        factor = 0.0
    if not 0.0 < factor < 1e6:
        raise ConfigError(f"--speed takes a number above 0, or {_FASTEST}, but not {speed:.40}.")
    return factor


def _host_and_port(text: str) -> tuple[str, int]:
    from twin.web.serve import LOOPBACK

    host, _, port = text.rpartition(":")
    if not (port.isascii() and port.isdigit() and int(port[:6]) < 2**16):
        raise ConfigError(f"--serve is {text:.40}: write HOST:PORT, as 127.0.0.1:8080, or a port alone.")
    return host or LOOPBACK, int(port)
