"""Every source of error of a simulated drive, with value and reason, and the processes that draw it."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np

from geoloc.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class NoiseSpec:
    """One-sigma values of each source of error (unless a field says otherwise).

    "Once" means drawn once for a drive: averaging over frames does not remove it. Sources marked with a
    dagger are not part of the estimator's own error model: real drives have such sources too.
    """

    gnss_white_horizontal_m: float = 0.006
    """Each fix, each axis, each antenna. Carrier-phase noise of a fixed RTK solution, short baseline."""
    gnss_white_vertical_m: float = 0.010
    """As above; the vertical is worse by 1.7 because no satellite is below the horizon."""
    gnss_slow_horizontal_m: float = 0.011
    """† Gauss–Markov, each axis, common to all antennas: atmosphere left over between the car and the virtual
    reference station. The middle of the 8 to 14 mm in plan that Kartverket states for CPOS."""
    gnss_slow_vertical_m: float = 0.023
    """† The same source; the middle of 17 to 30 mm in height."""
    gnss_slow_tau_s: float = 100.0
    """† Correlation time of the slow part: minutes, as atmosphere and satellite geometry change."""
    gnss_multipath_m: float = 0.004
    """† Gauss–Markov, each axis, each antenna: reflections differ between two antennas on one roof."""
    gnss_multipath_up: float = 1.0
    """Not a sigma: that of the height over that of a horizontal axis."""
    gnss_multipath_tau_s: float = 8.0
    """† Correlation time of multipath for a car that moves past the reflecting surroundings."""
    link_delay_ms: float = 78.0
    """Mean, not sigma. The host stamps a sentence when it arrives: 78.0 ms late on the NTNU car."""
    link_jitter_ms: float = 3.0
    """Each sentence. Operating system and network between receiver and host."""
    frame_offset_ms: float = 5.0
    """Once. Camera clock against UTC after the known readout latency has been taken off."""
    frame_jitter_ms: float = 0.3
    """† Each frame. Trigger and stamping jitter of a hardware-synchronised camera link."""
    row_delay_us: float = 26.0
    """† Not a sigma: time between the exposures of two rows. 1208 rows take 31 ms, which is what a 30 Hz
    rolling-shutter sensor needs (NVIDIA's default for such cameras is 32.6 ms). The epoch of a frame is that
    of its middle row, so the foot of a near pole, low in the image, is seen up to 13 ms later."""
    boresight_deg: float = 0.2
    """Once for a camera and axis. Mounting after the last calibration: thermal, service, a pothole."""
    camera_position_m: float = 0.005
    """† Once for a camera and axis. The calibration's own accuracy."""
    focal_relative: float = 3e-4
    """† Once for a camera. Temperature moves the focal length by about 20 ppm/K; calibration adds as much."""
    principal_point_px: float = 0.3
    """† Once for a camera and axis. Typical repeatability of a checkerboard calibration."""
    lever_arm_m: float = 0.015
    """Once for an antenna and axis. A tape measure on a car body."""
    rig_origin_m: float = 0.010
    """† Once for an axis, in all lever arms alike: the middle of the rear axle, from which the tape is laid,
    lies under the car, and the cameras' calibration has an origin of its own."""
    pitch_jitter_deg: float = 0.10
    """Damped oscillation at 50 km/h, grows with the square root of speed: body bounce on its springs."""
    roll_jitter_deg: float = 0.10
    """As pitch."""
    idle_jitter_deg: float = 0.01
    """Standing still: engine, wind, people in the car."""
    body_frequency_hz: float = 1.4
    """Not a sigma: natural frequency of a passenger car's sprung mass, 1.2 to 1.5 Hz."""
    body_damping: float = 0.3
    """Not a sigma: damping ratio of a passenger car's sprung mass, 0.2 to 0.4."""
    bounce_lasts_s: float = 0.0
    """Not a sigma: 0 for that oscillation; else the body's angles fade within so long (Gauss-Markov), and are
    as large at any speed above 3 m/s."""
    pitch_unrest_deg: float = 0.0
    """Between body and road, for a second of driving: what lies below one axle."""
    roll_unrest_deg: float = 0.0
    """The same, for six seconds: what lies below one wheel, a load that shifts."""
    pitching_axis: float = 0.0
    """Not a sigma: how much the body turns to the left as it pitches on its springs, radians a radian."""
    sideways_mps: float = 0.0
    """Every 0.2 s, at any speed: the rear axle rolls sideways besides its slip."""
    sideways_deg: float = 0.0
    """The same, as an angle of the way it takes."""
    dive_deg_per_mps2: float = 0.25
    """† Not a sigma: nose down when braking, 2.5 degrees per g for a family car."""
    roll_deg_per_mps2: float = 0.35
    """† Not a sigma: the body leans out of a bend, 3.5 degrees per g for a family car."""
    slip_deg_per_mps2: float = 0.25
    """Not a sigma: the rear axle drifts out of a bend by its tyres' compliance, 2 to 3 degrees per g."""
    slip_sigma_deg_per_mps2: float = 0.08
    """Once. Soft winter tyres and a full boot drift half as much again, hard tyres on an empty car half as
    little."""
    heave_m: float = 0.006
    """† The body's height over its wheels at 50 km/h, same process as pitch."""
    pole_radius_m: float = 0.03
    """† Not a sigma: the annotator marks the visible front of a 60 mm pole, the truth is its centre."""
    annotation_px: float = 1.5
    """Each sighting and axis: an annotator on a 1920 × 1208 image."""
    blunder_rate: float = 0.005
    """† Share of sightings on a wrong pixel: slips of the mouse, a neighbouring pole."""
    blunder_px: float = 40.0
    """† Radius of a blunder: uniform direction, uniform from half to one and a half times this."""

    @classmethod
    def none(cls) -> NoiseSpec:
        """Return a world without any error: what each test of the geometry starts from."""
        silent = dict.fromkeys((field.name for field in fields(cls)), 0.0)
        times = {
            "gnss_slow_tau_s": 100.0,
            "gnss_multipath_tau_s": 8.0,
            "body_frequency_hz": 1.4,
            "body_damping": 0.3,
        }
        return cls(**(silent | times))


@dataclass(frozen=True, slots=True)
class DrawnErrors:
    """What was drawn once for a drive: the truth about its systematic errors.

    Attributes
    ----------
    frame_offset_ms : float
        Added to the host stamp of every frame.
    boresight_deg : mapping camera → float64 (3,)
        Rotation vector about the rig's x, y, z axes from the rig file's camera to the true one.
    camera_position_m : mapping camera → float64 (3,)
        True position minus that of the rig file, rig axes.
    focal_relative : mapping camera → float
        True focal length over that of the rig file, minus one.
    principal_point_px : mapping camera → float64 (2,)
        True principal point minus that of the rig file.
    lever_arm_m : mapping antenna → float64 (3,)
        True lever arm minus that of the rig file.
    slip_deg_per_mps2 : float
        Slip angle of the rear axle a lateral acceleration.
    """

    frame_offset_ms: float
    boresight_deg: Mapping[str, FloatArray]
    camera_position_m: Mapping[str, FloatArray]
    focal_relative: Mapping[str, float]
    principal_point_px: Mapping[str, FloatArray]
    lever_arm_m: Mapping[str, FloatArray]
    slip_deg_per_mps2: float


def stream(seed: int, name: str) -> np.random.Generator:
    """Return the random stream of one source: a change to one source leaves the draws of all others alone."""
    return np.random.default_rng([seed, zlib.crc32(name.encode())])


def draw_errors(
    spec: NoiseSpec, seed: int, cameras: tuple[str, ...], antennas: tuple[str, ...]
) -> DrawnErrors:
    """Draw the errors that a drive keeps from its first to its last frame."""
    origin = stream(seed, "rig origin").normal(size=3) * spec.rig_origin_m
    return DrawnErrors(
        frame_offset_ms=float(stream(seed, "frame offset").normal(0.0, 1.0) * spec.frame_offset_ms),
        boresight_deg={
            n: stream(seed, f"boresight {n}").normal(size=3) * spec.boresight_deg for n in cameras
        },
        camera_position_m={
            n: stream(seed, f"position {n}").normal(size=3) * spec.camera_position_m for n in cameras
        },
        focal_relative={n: float(stream(seed, f"focal {n}").normal()) * spec.focal_relative for n in cameras},
        principal_point_px={
            n: stream(seed, f"principal point {n}").normal(size=2) * spec.principal_point_px for n in cameras
        },
        lever_arm_m={
            n: stream(seed, f"lever arm {n}").normal(size=3) * spec.lever_arm_m + origin for n in antennas
        },
        slip_deg_per_mps2=drawn_slip_deg_per_mps2(spec, seed),
    )


def drawn_slip_deg_per_mps2(spec: NoiseSpec, seed: int) -> float:
    """Draw how far the rear axle of this drive's car slips."""
    spread = float(stream(seed, "slip").normal()) * spec.slip_sigma_deg_per_mps2
    return spec.slip_deg_per_mps2 + spread


def gauss_markov(rng: np.random.Generator, epoch_s: FloatArray, sigma: float, tau_s: float) -> FloatArray:
    """First-order Gauss–Markov process: stationary, autocorrelation ``sigma² exp(-|Δt| / tau)``.

    Parameters
    ----------
    epoch_s : float64 (n,)
        Increasing; need not be even.
    """
    decay = np.exp(-np.diff(epoch_s, prepend=epoch_s[:1]) / tau_s)
    kicks = rng.normal(size=epoch_s.size)
    kicks[1:] *= np.sqrt(1.0 - decay[1:] ** 2)
    value, out = 0.0, []
    for rho, kick in zip(decay.tolist(), kicks.tolist(), strict=True):
        value = rho * value + kick
        out.append(value)
    return np.array(out) * sigma


def damped_oscillation(
    rng: np.random.Generator, count: int, step_s: float, frequency_hz: float, damping: float
) -> FloatArray:
    """Unit-variance noise of a damped oscillator: what a sprung mass does on a random road.

    The real part of a complex first-order autoregression, an AR(2) process with the autocorrelation
    ``exp(-damping·ω·τ) cos(ω·τ)``.

    Parameters
    ----------
    count : int
        Number of samples, `step_s` apart.
    """
    from scipy.signal import lfilter

    omega = 2.0 * np.pi * frequency_hz
    rho = np.exp(-damping * omega * step_s)
    turn = complex(rho * np.exp(1j * omega * step_s))
    kicks = rng.normal(size=(count, 2)) @ np.array([1.0, 1j])
    kicks[1:] *= np.sqrt(1.0 - rho * rho)
    return np.asarray(lfilter([1.0], [1.0, -turn], kicks).real)
