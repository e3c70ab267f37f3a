"""Drives whose frames come as videos, images and tables: what their times are, and what is refused."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import pytest

from twin.drives.drive import Drive
from twin.drives.frames.read import Frame, frames
from twin.drives.frames.stamp_files import NO_STAMP
from twin.errors import DriveError

TIMES_MS = [0, 33, 66, 100, 140, 166, 200, 240, 266, 300]
TENTHS = [100 * i for i in range(10)]
NAMES = [f"20260610_10000{i // 10}_{i % 10}00.jpg" for i in range(12)]


def _skipped(drive: Any) -> dict[str, int]:
    return {f"{s.what}: {s.reason}": s.count for s in drive.skipped}


@pytest.mark.parametrize(
    "start", ['"2026-06-10T08:00:00Z"', '"2026-06-10T10:00:00+02:00"', "2026-06-10T08:00:00Z"]
)
def test_container_gives_times_from_its_start(small: Any, start: str) -> None:
    """Start plus presentation time, at a variable rate; the start as text or as TOML's own instant."""
    small.add("front.mp4", small.movies.video(TIMES_MS))
    small.settings(f'[frames.front]\nfile = "front.mp4"\nstart = {start}')
    small.annotate_video(3)
    assert small.seconds(small.read()) == pytest.approx(np.array(TIMES_MS) / 1000, abs=1e-4)


def test_container_without_start_begins_at_its_tag_with_a_warning(small: Any) -> None:
    """creation_time is what is left; that it may be another moment is said."""
    small.add("front.mp4", small.movies.video(TIMES_MS, tags={"creation_time": "2026-06-10T08:00:00Z"}))
    small.annotate_video(3)
    drive = small.read()
    assert small.seconds(drive)[:2] == pytest.approx([0.0, 0.033], abs=1e-4)
    assert any("creation_time" in warning.sentence for warning in drive.warnings)


def test_too_many_stamps_are_refused_until_the_user_says_so(small: Any) -> None:
    """Five more stamps than frames: refused, unless ``frames_by_number`` settles it."""
    small.add("front.h264", small.movies.video(TENTHS, "h264"))
    small.stamps(15)
    small.annotate_video(3)
    with pytest.raises(DriveError, match=r"front.h264 holds 10 frames, front.timestamps stamps for 15"):
        small.read()
    small.settings("", top="frames_by_number = true")
    assert len(small.read().frame_epoch_ns["front"]) == 10


@pytest.mark.parametrize(
    ("content", "said"),
    [(b"", "is empty"), (b"<html>404</html>", "web page"), (b"\0" * 4000, "not a video")],
)
def test_broken_video_beside_good_stamps_costs_a_warning(small: Any, content: bytes, said: str) -> None:
    """What annotations need are the stamps: the video is only said to be broken."""
    small.add("front.h264", content)
    small.stamps(10)
    small.annotate_video(3)
    drive = small.read()
    assert len(drive.annotations.frame) == 1
    assert any(said in warning.sentence for warning in drive.warnings)


NUMBERED = '[frames.front]\nfile = "some/"\nnumbered = true\n'


def test_some_frames_as_images_keep_the_numbers_in_their_names(small: Any) -> None:
    """Every third frame was cut out: all stamps stay, and each picture is that of its own frame."""
    for number in (0, 3, 6):
        small.add(f"some/frame_{number:06d}.jpg", small.movies.jpeg())
    small.settings(NUMBERED)
    small.stamps(10)
    small.annotate_video(3)
    drive = small.read()
    pictures, epoch_ns = drive.pictures["front"], drive.frame_epoch_ns["front"]
    assert len(epoch_ns) == 10
    assert [frame for frame in range(12) if pictures.has(frame)] == [0, 3, 6]
    faults: Counter[str] = Counter()
    decoded = list(frames(pictures, epoch_ns, np.ones(10, dtype=np.bool_), faults))
    assert [frame.number for frame in decoded] == [0, 3, 6]
    assert faults == {"no picture of this frame": 7}


@pytest.mark.parametrize(
    ("names", "stamps", "said"),
    [
        (("a.jpg",), 10, r"some/a.jpg says no frame number: .* each image is named"),
        (("a_3.jpg", "b_003.jpg"), 10, r"b_003.jpg says frame 3, as some/a_3.jpg does"),
        (("20.jpg",), 10, r"Not one image of some/ is of a frame that front.timestamps has a stamp for"),
        (("3.jpg",), 0, r"numbered = true in drive.toml, which says their frames but no times"),
    ],
)
def test_numbered_images_that_do_not_fit_are_told(
    small: Any, names: tuple[str, ...], stamps: int, said: str
) -> None:
    """Names without a number, two of one frame, another recording's, and numbers without times."""
    for name in names:
        small.add(f"some/{name}", small.movies.jpeg())
    small.settings(NUMBERED)
    if stamps:
        small.stamps(stamps)
    small.annotate_video(3)
    with pytest.raises(DriveError, match=said):
        small.read()


@pytest.mark.parametrize("zone", [2.0, 2])
def test_images_are_timed_by_their_names(small: Any, zone: float) -> None:
    """A frame's number is the image's place in the folder, its time stands in its name."""
    for name in NAMES:
        small.add(f"pictures/{name}", small.movies.jpeg())
    small.settings(f'[frames.front]\nfile = "pictures/"\nutc_offset_hours = {zone}')
    small.annotate_images(f"drive7/{NAMES[5]}", NAMES[11].removesuffix(".jpg"), "other.jpg")
    drive = small.read()
    assert small.seconds(drive) == pytest.approx(np.arange(12) / 10)
    assert drive.annotations.frame.tolist() == [5, 11]
    assert _skipped(drive) == {"annotations: image that is not among the drive's pictures": 1}


def test_images_with_numbers_are_in_order_of_their_numbers(small: Any) -> None:
    """9 comes before 10; a table gives the times by name, with a folder or without."""
    for i in range(8, 12):
        small.add(f"pictures/f{i}.png", small.movies.jpeg(form="PNG"))
    rows = [f"cam\\f{i}.png,{small.start_ns + i * 100_000_000}" for i in (11, 10, 9, 8, 7)]
    small.add("times.csv", "\n".join(["image,time_ns", *rows, "f8.png,1", "nonsense"]))
    small.settings('[frames]\nfront = "pictures/"\n[timestamps]\nfront = "times.csv"')
    small.annotate_images("f10.png")
    drive = small.read()
    assert small.seconds(drive) == pytest.approx([0.8, 0.9, 1.0, 1.1])
    assert drive.annotations.frame.tolist() == [2]
    assert _skipped(drive) == {
        "time stamps: no picture of that name": 1,
        "time stamps: not an image and a stamp": 1,
        "time stamps: stamp outside the years 2000–2099": 1,
    }


def test_images_whose_times_go_back_are_left_out(small: Any) -> None:
    """Of five images in order one is an hour early: it loses its time, and no other does."""
    for i in range(5):
        epoch_s = 1_781_078_400 + i - (3600 if i == 2 else 0)
        small.add(f"pictures/f{i}_{epoch_s}.5.png", small.movies.jpeg(form="PNG"))
    small.settings('[frames]\nfront = "pictures"')
    small.annotate_images("f1_1781078401.5.png")
    drive = small.read()
    assert np.flatnonzero(drive.frame_epoch_ns["front"] == NO_STAMP).tolist() == [2]
    assert _skipped(drive) == {"time stamps: stamp not later than that of the frame before": 1}


def test_table_of_images_is_enough_without_the_images(small: Any) -> None:
    """Whoever was given annotations and a table, but not the pictures, can place them."""
    rows = [f"f{i}.png,{small.start_ns + i * 100_000_000}" for i in range(8, 12)]
    small.add("times.csv", "\n".join(["image,time_ns", *rows]))
    small.settings('[timestamps]\nfront = "times.csv"')
    small.annotate_images("f10.png")
    drive = small.read()
    assert drive.annotations.frame.tolist() == [2]
    assert small.seconds(drive) == pytest.approx([0.8, 0.9, 1.0, 1.1])


def test_images_are_timed_by_exif_where_names_say_nothing(small: Any) -> None:
    """DateTimeOriginal with fraction; the zone by settings; one image without tags has no time."""
    for i in range(4):
        tags = {0x9003: f"2026:06:10 10:00:0{i}", 0x9291: "5"} if i != 2 else {}
        small.add(f"pictures/DSC{i:04d}.jpg", small.movies.jpeg(ifd=tags))
    small.settings('[frames.front]\nfile = "pictures"\nutc_offset_hours = 2')
    small.annotate_images("DSC0003.jpg")
    drive = small.read()
    stamps = drive.frame_epoch_ns["front"]
    assert stamps[2] == NO_STAMP
    assert ((stamps[[0, 1, 3]] - small.start_ns) / 1e9).tolist() == [0.5, 1.5, 3.5]
    assert _skipped(drive) == {"frames: no time in name or EXIF": 1}


def test_whole_seconds_are_warned_of(small: Any) -> None:
    """A camera that writes seconds only places signs many metres off."""
    for i in range(3):
        small.add(f"pictures/{1781078400 + i}.jpg", small.movies.jpeg())
    small.settings('[frames]\nfront = "pictures/"')
    small.annotate_images("1781078401.jpg")
    assert any("whole seconds" in warning.sentence for warning in small.read().warnings)


FOLDER = '[frames]\nfront = "pictures"'
TABLE = f'{FOLDER}\n[timestamps]\nfront = "times.csv"'
MP4, F1 = "front.mp4", "pictures/f1.jpg"
STAMP = "1781078400000000000"
OF_VIDEO = '[frames.front]\nfile = "front.mp4"\n'


@pytest.mark.parametrize(
    ("picture", "settings", "times", "said"),
    [
        # No time at all: the sentence shows what to write, and nothing is guessed.
        (MP4, "", "", r'\[frames.front\] file = "front.mp4" and start'),
        ("front.h264", "", "", "raw h264 stream, which carries no times"),
        (f"pictures/{NAMES[0]}", FOLDER, "", r"utc_offset_hours under \[frames.front\]"),
        (F1, '[frames]\nfront = "pictures/"', "", "name a table image,time_ns"),
        # A table that is empty, nonsense, of other images, or of a video.
        (F1, TABLE, "", "holds no usable time stamp"),
        (F1, TABLE, "f1.jpg,17\nf2.jpg\n", "1 × not an image and a stamp; 1 × stamp outside"),
        (F1, TABLE, f"g1.jpg,{STAMP}\n", "Not one image that times.csv names is in pictures"),
        (MP4, TABLE.replace("pictures", MP4), f"f1.jpg,{STAMP}\n", "the pictures are a video"),
        # Settings: the key, and what it must be.
        (MP4, '[frames]\nfront = "nothing.mp4"', "", "nothing.mp4 is not in"),
        (MP4, '[frames]\nfront = "../other"', "", "lies outside the drive folder"),
        (MP4, '[frames]\nfront = "empty/"', "", "holds no images"),
        (MP4, '[frames]\nrear = "front.mp4"', "", "names the camera rear"),
        (MP4, f'{OF_VIDEO}start = "2026-06-10T08:00:00"', "", "an instant with its zone"),
        (MP4, f"{OF_VIDEO}start = 0001-01-01T00:00:00Z", "", "in the years 2000"),
        (MP4, f"{OF_VIDEO}utc_offset_hours = 200", "", "a number from -14 to 14"),
        (MP4, '[frames.front]\nstart = "2026-06-10T08:00:00Z"', "", "a video or a folder"),
        (MP4, '[frames.front]\nfle = "front.mp4"', "", r"nearest known one is \[frames.front\] file"),
    ],
)
def test_frames_that_cannot_be_timed_are_refused(
    small: Any, picture: str, settings: str, times: str, said: str
) -> None:
    """What is missing or wrong, where, and the lines to write."""
    small.add("empty/readme.txt", "no images")
    small.add("times.csv", f"image,time_ns\n{times}")
    if picture.endswith(".jpg"):
        small.add(picture, small.movies.jpeg())
        small.annotate_images(picture.rpartition("/")[2])
    else:
        small.add(picture, small.movies.video(TENTHS, picture.rpartition(".")[2]))
        small.annotate_video(3)
    small.settings(settings)
    with pytest.raises(DriveError, match=said):
        small.read()


def every_frame(drive: Drive) -> tuple[list[Frame], Counter[str]]:
    """All frames of the camera front that can be read, and why the others cannot."""
    stamps, faults = drive.frame_epoch_ns["front"], Counter[str]()
    wanted = np.ones(len(stamps), dtype=np.bool_)
    return list(frames(drive.pictures["front"], stamps, wanted, faults)), faults


def test_image_link_that_leads_out_of_the_folder_is_not_read(small: Any, tmp_path: Any) -> None:
    """A link among the images to a file elsewhere is counted, not followed."""
    (tmp_path / "secret.png").write_bytes(small.movies.jpeg(form="PNG"))
    for i in range(3):
        small.add(f"pictures/{1781078400 + i}.5.png", small.movies.jpeg(form="PNG"))
    (small.root / "pictures" / "1781078403.5.png").symlink_to(tmp_path / "secret.png")
    small.settings('[frames]\nfront = "pictures/"')
    small.annotate_images("1781078401.5.png")
    drive = small.read()
    found, faults = every_frame(drive)
    assert [frame.number for frame in found] == [0, 1, 2]
    assert faults == {"image unreadable": 1}


def test_damaged_images_and_frames_are_counted_while_reading(small: Any) -> None:
    """An empty image, a web page and one that was cut come with their reasons; the rest comes out."""
    for i, content in enumerate([small.movies.jpeg(), b"", b"<html>", small.movies.jpeg()[:100]]):
        small.add(f"pictures/{1781078400 + i}.5.jpg", content)
    small.settings('[frames]\nfront = "pictures/"')
    small.annotate_images("1781078400.5.jpg")
    drive = small.read()
    found, faults = every_frame(drive)
    assert [(frame.number, frame.epoch_ns) for frame in found] == [(0, small.start_ns + 500_000_000)]
    assert sum(faults.values()) == 3


def test_video_frames_come_with_their_stamps(small: Any) -> None:
    """Number, epoch and picture belong together."""
    small.add("front.h264", small.movies.video(TENTHS, "h264"))
    small.stamps(10)
    small.annotate_video(3)
    drive = small.read()
    wanted = np.arange(10) % 4 == 0
    found = list(frames(drive.pictures["front"], drive.frame_epoch_ns["front"], wanted, Counter()))
    assert [(f.number, small.movies.number(f.image)) for f in found] == [(0, 0), (4, 4), (8, 8)]
    assert [f.epoch_ns - small.start_ns for f in found] == [0, 400_000_000, 800_000_000]
