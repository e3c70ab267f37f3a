"""The keys of ``drive.toml`` and ``labels.toml``: what each takes, what holds without it, what it means.

The readers know these keys and no others. ``make reference`` writes docs/reference/ from them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from geoloc.adjustment.adjust import POLE_RADIUS_M


class Key(NamedTuple):
    """One key.

    Attributes
    ----------
    takes : str
        Kind and unit of its value.
    default : str
        What holds where the file does not have it; "" where it must.
    meaning : str
    """

    takes: str
    default: str
    meaning: str


_FOUND = "found in the folder"
_FROM_RIG = "the rig file's"

ROOT_KEYS: Mapping[str, Key] = {
    "name": Key("text", "the folder's name", "what the drive is called"),
    "rig": Key("file", _FOUND, "the rig file; not needed where [cameras] says all"),
    "rig_pose": Key(
        "calibrated or nominal",
        "calibrated",
        "which pose of the rig file counts where it has both, sensor2Rig or nominalSensor2Rig",
    ),
    "datum": Key(
        "EUREF89, ITRF2014 or ITRF2020",
        "EUREF89",
        "of the positions; an ITRF is brought to EUREF89 at the epoch of each fix",
    ),
    "annotations_complete": Key(
        "true or false",
        "false",
        "whether every sign pole in view is annotated, also if it faces away; else no sign is missing",
    ),
    "detections_complete": Key("true or false", "false", "the same of what a detector finds"),
    "camera_offset_ms": Key(
        "milliseconds", "0", "added to the frame stamps, to give the exposure of the middle row"
    ),
    "rolling_shutter_ms": Key(
        "milliseconds", "estimated", "from the exposure of the first row to the last; 0 for a global shutter"
    ),
    "first_frame": Key(
        "0 or 1", "0", "number of the first frame in a CSV of annotations and in names of images"
    ),
    "frames_by_number": Key(
        "true or false", "false", "whether frame 0 has stamp 0 and so on, even if there are more of one"
    ),
    "pole_radius_m": Key("metres", f"{POLE_RADIUS_M:g}", "from the visible foot to the middle of the pole"),
    "pitch_positive": Key("nose_down or nose_up", "nose_down", "which pitch of poses.csv is positive"),
    "cameras": Key("a table for each camera", _FROM_RIG, "lens and place, instead of the rig file's"),
    "gnss": Key("table", _FOUND, "GNSS recordings; not together with [poses]"),
    "poses": Key("table", _FOUND, "full poses: position and attitude"),
    "motion": Key("table, or one for each source", "none", "what the car measured of its own motion"),
    "timestamps": Key("camera = file", _FOUND, "when each frame was taken"),
    "frames": Key("camera = file, folder or table", _FOUND, "the pictures: a video or a folder of images"),
    "annotations": Key(
        "camera = file, folder or a list of them", _FOUND, "what was annotated in its pictures"
    ),
    "errors": Key(
        "term = one sigma", "the error budget's", "terms of the error budget that are better known"
    ),
}
CAMERA_KEYS: Mapping[str, Key] = {
    "intrinsics": Key(
        "file, or file#camera", _FROM_RIG, "a calibration file; #camera where it holds several"
    ),
    "position": Key(
        "[x, y, z], metres", _FROM_RIG, "where the camera sits in the rig frame; together with roll_pitch_yaw"
    ),
    "roll_pitch_yaw": Key(
        "[roll, pitch, yaw], degrees",
        _FROM_RIG,
        "how it looks: right side down, nose down and left are positive; together with position",
    ),
    "lens": Key(
        "name of a common camera", "", "nominal intrinsics, where nobody calibrated (twin help dashcam)"
    ),
    "fov_deg": Key(
        "degrees", "", "field of view across the longer side of the picture, where nobody calibrated"
    ),
    "projection": Key("pinhole or fisheye", "by the field of view", "of fov_deg"),
    "size": Key("[width, height], pixels", "", "of the pictures; needed beside lens or fov_deg"),
    "mask": Key("picture", _FROM_RIG, "black on the car itself, white elsewhere"),
}
GNSS_KEYS: Mapping[str, Key] = {
    "files": Key("antenna = file", _FOUND, "the recording of each antenna"),
    "lever_arms": Key("antenna = [x, y, z], metres", _FROM_RIG, "where each antenna sits in the rig frame"),
    "topics": Key("antenna = topic", "the only one", "of ROS recordings with several topics of positions"),
    "sigma_m": Key(
        "metres", "by quality of the fix", "horizontal one sigma of fixes whose recording states none"
    ),
    "heading_offset_deg": Key(
        "degrees", "as written", "the car's nose, clockwise from the heading that its receiver writes"
    ),
    "heading_sigma_deg": Key(
        "degrees", "0.5; 3 of SBP without fixed ambiguities", "one sigma of that heading"
    ),
}
POSE_KEYS: Mapping[str, Key] = {
    "file": Key("file", _FOUND, "poses.csv, SBP with attitude, or a ROS recording"),
    "lever_arm": Key(
        "[x, y, z], metres",
        "the rig's origin",
        "where the point sits in the rig frame whose positions they are",
    ),
    "topics": Key("position = topic, attitude = topic", "the only ones", "of a ROS recording with several"),
    "sigma_m": Key("metres", "estimated", "one sigma, a horizontal axis, of poses whose file states none"),
    "sigma_height_m": Key("metres", "1.7 times sigma_m", "likewise, of the height"),
    "sigma_roll_pitch_deg": Key("degrees", "estimated", "likewise, of roll and pitch"),
    "sigma_heading_deg": Key("degrees", "estimated", "likewise, of the heading"),
}
POSE_TOPIC_KEYS: Mapping[str, Key] = {
    "position": Key("topic", "the only one", "NavSatFix or Odometry"),
    "attitude": Key("topic", "the only one", "Imu"),
}
MOTION_KEYS: Mapping[str, Key] = {
    "file": Key("file or folder", "", "a table (CSV), a log of a CAN bus, or another recording"),
    "dbc": Key("file", "", "what the messages of a CAN log mean; needed beside one"),
    "time": Key("column", "", "when each row of a table was measured"),
    "time_unit": Key("s, ms, us, ns or iso", "", "of that column; iso for 2026-06-10T07:59:59.123Z"),
    "time_zero": Key(
        "unix, gps, or an instant with its zone",
        "unix, where it gives a credible year",
        "what the times count from: 1970, 1980-01-06 on GPS time, or that instant",
    ),
    "utc_offset_hours": Key(
        "hours", "", "zone of times on a clock for people (ASC, BLF, TRC, iso without one): 0 for UTC"
    ),
    "speed": Key(
        "column, MESSAGE.SIGNAL or topic, or a list of them",
        "the recording's own",
        "speed over ground at the rear axle; of several, as of both rear wheels, the mean",
    ),
    "speed_unit": Key(
        "m/s, km/h, mph, kn; rad/s or rpm of a wheel; tick",
        "what the recording states",
        "of the speed; needed of a table",
    ),
    "speed_sigma_mps": Key("metres a second", "estimated", "one sigma of a value's own noise"),
    "turn_rate": Key("as speed", "the recording's own", "rate of turn about the car's upward axis"),
    "turn_rate_unit": Key("rad/s or deg/s", "what the recording states", "of the rate; needed of a table"),
    "turn_rate_positive": Key("left or right", "left", "which turn is positive"),
    "turn_rate_axis": Key(
        "x, y, z, -x, -y or -z",
        "what the format defines",
        "which axis of the gyro points up in the car; -z where z points down",
    ),
    "turn_rate_sigma_deg_s": Key("degrees a second", "estimated", "one sigma of a value's own noise"),
    "wheel_angle": Key("as speed", "the recording's own", "angle of the front wheels, or the steering wheel"),
    "wheel_angle_unit": Key("rad or deg", "what the recording states", "of the angle; needed of a table"),
    "wheel_angle_positive": Key("left or right", "left", "which angle is positive"),
    "wheel_angle_sigma_deg": Key(
        "degrees", "estimated", "one sigma of a value's own noise, as an angle of the front wheels"
    ),
    "steering_ratio": Key("number", "1", "turn of the steering wheel for one of the front wheels"),
    "wheel_radius_m": Key("metres", _FROM_RIG, "of a speed in rad/s or rpm of a wheel"),
    "metres_per_tick": Key("metres", "", "of a speed in ticks of a wheel"),
    "wheelbase_m": Key("metres", _FROM_RIG, "rear axle to front axle; of [motion] itself"),
    "lag_ms": Key("milliseconds", "0", "how much later than the measurement the stamps are"),
    "lag_sigma_ms": Key("milliseconds", "100", "one sigma of lag_ms"),
}
FRAME_KEYS: Mapping[str, Key] = {
    "file": Key("video, or folder of images", "", 'the pictures; front = "front.mp4" says the same in short'),
    "start": Key(
        "instant with its zone",
        "what the video says",
        "of the first frame of a video: 2026-06-10T07:59:59.123Z",
    ),
    "utc_offset_hours": Key(
        "hours", "what the images say", "zone of the times in names or tags of images: 2 in Norwegian summer"
    ),
    "numbered": Key(
        "true or false", "false", "whether the folder holds some of the frames, named after their numbers"
    ),
}
LABEL_KEYS: Mapping[str, Key] = {
    "foot_keypoints": Key("list of names", "none", "further names of key points that are the foot of a pole"),
    "labels": Key(
        "label = meaning",
        "none",
        "what each label is; * in a label stands for anything. A sign code, a list of them, { type = 14 }, "
        "{ type = 9, ground = true } for what lies on the ground, or ignore",
    ),
}
