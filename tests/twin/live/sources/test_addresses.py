"""Addresses: what each says, and what none may."""

from __future__ import annotations

from pathlib import Path

import pytest
from live_senders import ROOF, WIDE, MakeCar

from twin.drives.detection.run import DetectorOptions
from twin.errors import ConfigError, DriveError
from twin.live.car import Car, antennas_of, read_car
from twin.live.sources import Gives, open_source
from twin.live.sources.address import PICTURE_SCHEMES, address_of


@pytest.mark.parametrize(
    ("url", "gives", "message"),
    [
        ("com3", Gives.FIXES, r"com3 is no address that fits here: it begins with one of gpsd://, mcap://"),
        ("mqtt://broker/car", Gives.FIXES, "mqtt:// is no address that fits here"),
        ("tcp://host", Gives.FIXES, r"tcp://host has no port: .* as in tcp://host:9000"),
        ("tcp://:9000", Gives.FIXES, "names no host"),
        ("tcp://host:99999", Gives.FIXES, "no address: correct it"),
        ("serial:///dev/ttyUSB0?baud=fast", Gives.FIXES, "baud takes a whole number above 0, but not fast"),
        ("serial://", Gives.FIXES, "names no file or device"),
        ("udp://:9000?antena=roof", Gives.FIXES, "does not know the option antena: it knows antenna"),
        ("tcp://host:9000?antenna=left", Gives.FIXES, f"has no antenna left: it has {ROOF}"),
        ("mqtt://broker", Gives.DETECTIONS, "names no topic"),
        ("rtsp://car:secret@x/y", Gives.DETECTIONS, "^rtsp://x:554/y gives pictures: .* --detector"),
        ("mcap:///nowhere/a.mcap?speed=quick", Gives.DETECTIONS, "speed takes a number above 0, or max"),
        ("ros2:///fix", Gives.FIXES, r"needs rclpy, .* set up \(source /opt/ros"),
    ],
)
def test_address_that_is_none_is_refused(car: Car, url: str, gives: Gives, message: str) -> None:
    """What is wrong with it, and what would be right."""
    with pytest.raises(ConfigError, match=message):
        open_source(url, gives, car)


def test_no_name_and_no_message_has_a_password(car: Car) -> None:
    """User, password and options of a camera stay in the address."""
    url = "rtsp://car:secret@camera/stream?token=secret2&camera=C3_tricam120"
    address = address_of(url, PICTURE_SCHEMES)
    assert address.name == "rtsp://camera:554/stream"
    assert "secret" not in repr(address)
    assert address.without("camera") == "rtsp://car:secret@camera/stream?token=secret2"
    with pytest.raises(ConfigError) as refused:
        open_source("mqtt://car:secret@broker", Gives.DETECTIONS, car)
    assert "secret" not in str(refused.value)
    with pytest.raises(ConfigError) as refused:
        address_of("http//car:secret@host/", PICTURE_SCHEMES)
    assert "secret" not in str(refused.value)


def test_car_of_several_antennas_and_cameras_asks_which(sample: Path, tmp_path: Path) -> None:
    """The sample's has two and three; each antenna has one address."""
    car = read_car(sample / "trip_trondheim")
    with pytest.raises(ConfigError, match=rf"say whose fixes .* \?antenna={ROOF}"):
        antennas_of(car, ["tcp://host:1"])
    with pytest.raises(ConfigError, match=f"Two addresses give fixes of {ROOF}"):
        antennas_of(car, [f"tcp://host:1?antenna={ROOF}", f"udp://:2?antenna={ROOF}"])
    options = DetectorOptions(tmp_path / "none.onnx")
    with pytest.raises(ConfigError, match=r"say whose pictures .* \?camera=C1_front60Single"):
        open_source("v4l2:///dev/video0", Gives.DETECTIONS, car, detector=options)
    with pytest.raises(DriveError, match=r"none\.onnx cannot be read"):
        open_source(f"v4l2:///dev/video0?camera={WIDE}", Gives.DETECTIONS, car, detector=options)


def test_car_without_antennas_has_one_where_the_rig_is(make_car: MakeCar) -> None:
    """And lever arms of ``drive.toml`` make more; what it says of recordings is not asked for."""
    car = make_car(sensors=(WIDE,))
    assert antennas_of(car, ["tcp://host:1"]) == ("gnss",)
    assert not car.live_car(("gnss",)).rig.antennas["gnss"].rig_t_antenna_m.any()
    car = make_car(
        "[gnss]\nlever_arms = { left = [1.0, 0.5, 1.6], right = [1.0, -0.5, 1.6] }", sensors=(WIDE,)
    )
    live = car.live_car(antennas_of(car, ["tcp://host:1?antenna=right"]))
    assert live.antennas == ("right",)
    assert live.rig.antennas["right"].rig_t_antenna_m.tolist() == [1.0, -0.5, 1.6]
