"""Ways to damage a drive folder: each function makes one that takes the folder and spoils it."""

from __future__ import annotations

import functools
import io
import operator
import re
from collections.abc import Callable, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

Damage = Callable[[Path], None]
Fix = tuple[list[str], int]
"""Fields of a GGA sentence, and its host stamp in µs."""

GNSS = ("gnss50_vehicle.bin", "gnss52_vehicle.bin")
CAMERA = "C3_tricam120"
STAMPS, MARKS, SETTINGS = f"{CAMERA}.h264.timestamps", f"{CAMERA}.xml", "drive.toml"


def fixes(change: Callable[[int, list[str], int], Fix | None], files: Sequence[str] = GNSS) -> Damage:
    """Send every fix, by its number, through `change`; None leaves it out."""

    def damage(drive: Path) -> None:
        for name in files:
            lines = []
            for number, line in enumerate((drive / name).read_text().splitlines()):
                text, host = line.split()
                changed = change(number, text[1:].split("*")[0].split(","), int(host))
                lines += [] if changed is None else [_sentence(*changed)]
            (drive / name).write_text("".join(lines))

    return damage


def _sentence(fields: list[str], host_us: int) -> str:
    body = ",".join(fields)
    return f"${body}*{functools.reduce(operator.xor, body.encode()):02X} {host_us}\n"


def field(index: int, *values: str, first: int = 0, last: int = 10_000) -> Damage:
    """Put other values into the fields from `index` on of the fixes ``first`` to ``last - 1``."""

    def change(number: int, fields: list[str], host_us: int) -> Fix:
        if first <= number < last:
            fields = [*fields[:index], *values, *fields[index + len(values) :]]
        return fields, host_us

    return fixes(change)


def fixes_later(seconds: float, *, first: int = 0, last: int = 10_000) -> Damage:
    """Change the UTC that is written in the sentences."""

    def change(number: int, fields: list[str], host_us: int) -> Fix:
        if first <= number < last:
            text = fields[1]
            at = int(text[:2]) * 3600 + int(text[2:4]) * 60 + float(text[4:]) + seconds
            fields = [fields[0], f"{at // 3600:02.0f}{at // 60 % 60:02.0f}{at % 60:05.2f}", *fields[2:]]
        return fields, host_us

    return fixes(change)


def hosts_later(seconds: float, files: Sequence[str] = GNSS) -> Damage:
    """Change the host stamps of the fixes; whole days of it are another day."""
    return fixes(lambda _number, fields, host_us: (fields, host_us + round(seconds * 1e6)), files)


def frozen(files: Sequence[str], first: int, last: int) -> Damage:
    """Let receivers repeat one position."""
    held: dict[str, list[str]] = {}

    def change(name: str, number: int, fields: list[str], host_us: int) -> Fix:
        if number == first:
            held[name] = fields[2:]
        return [*fields[:2], *held[name]] if first <= number < last else fields, host_us

    return both(*(fixes(functools.partial(change, name), [name]) for name in files))


def frames_later(seconds: float) -> Damage:
    """Change the stamps of all frames."""

    def damage(drive: Path) -> None:
        for path in drive.glob("*.timestamps"):
            rows = [line.split() for line in path.read_text().splitlines()]
            path.write_text("".join(f"{number}\t{int(at) + round(seconds * 1e6)}\n" for number, at in rows))

    return damage


def edited(name: str, old: str, new: str, count: int = 1) -> Damage:
    """Replace what matches in a text file."""

    def damage(drive: Path) -> None:
        text, n_found = re.subn(old, lambda _found: new, (drive / name).read_text(), count=count)
        assert n_found
        (drive / name).write_text(text)

    return damage


def put(name: str, content: bytes | str) -> Damage:
    """Write a file."""

    def damage(drive: Path) -> None:
        path = drive / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content.encode() if isinstance(content, str) else content)

    return damage


def added(text: str) -> Damage:
    """Write a table behind ``drive.toml``."""
    return lambda drive: put(SETTINGS, f"{(drive / SETTINGS).read_text()}\n{text}\n")(drive)


def stamped_by(name: str) -> Damage:
    """Name a file of stamps."""
    return added(f'[timestamps]\n{CAMERA} = "{name}"')


def moved(old: str, new: str) -> Damage:
    """Rename a file."""

    def damage(drive: Path) -> None:
        (drive / old).rename(drive / new)

    return damage


def linked(name: str, target: str) -> Damage:
    """Put a link in place of a file."""

    def damage(drive: Path) -> None:
        (drive / name).unlink(missing_ok=True)
        (drive / name).symlink_to(target)

    return damage


def encoded(name: str, encoding: str) -> Damage:
    """Save a text file in another encoding, whatever it says of itself."""
    return lambda drive: put(name, (drive / name).read_text().encode(encoding))(drive)


def without(name: str) -> Damage:
    """Delete a file."""
    return lambda drive: (drive / name).unlink()


def both(*damages: Damage) -> Damage:
    """One after the other."""

    def damage(drive: Path) -> None:
        for one in damages:
            one(drive)

    return damage


def filmed(content: bytes, *, stamps: bool) -> Damage:
    """Add a video of the camera, with the recorder's stamps or with its own times."""
    table = f'[frames.{CAMERA}]\nfile = "C3.mp4"\nstart = "2026-06-10T08:00:00Z"'
    damage = both(put("C3.mp4", content), added(table))
    return damage if stamps else both(damage, without(STAMPS))


def photographed(left_out: range = range(0), **others: bytes) -> Damage:
    """Replace the stamps by a folder of images with times in their names, and some other images."""

    def damage(drive: Path) -> None:
        times = [line.split()[1] for line in (drive / STAMPS).read_text().splitlines()]
        (drive / "front").mkdir()
        for number, time_us in enumerate(times):
            if number not in left_out:
                (drive / "front" / f"{time_us}.png").write_bytes(b"\x89PNG\r\n\x1a\n")
        for name, content in others.items():
            (drive / "front" / f"{name}.png").write_bytes(content)
        without(STAMPS)(drive)
        added(f'[frames]\n{CAMERA} = "front/"')(drive)

    return damage


def video(times_ms: Sequence[int]) -> bytes:
    """Encode a small video with a frame at each time."""
    import av

    file = io.BytesIO()
    with av.open(file, "w", format="mp4") as container:
        stream: Any = container.add_stream("libx264", rate=30, options={"preset": "ultrafast"})
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        stream.codec_context.time_base = Fraction(1, 1000)
        picture = np.zeros((48, 64, 3), dtype=np.uint8)
        for time_ms in times_ms:
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
            frame.pts, frame.time_base = time_ms, Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return file.getvalue()
