"""Velocities and headings in SwiftNav SBP recordings."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pytest
from left_out import counts
from sbp.msg import SBP
from sbp.navigation import MsgPosLLHGnss, MsgVelNEDCov, MsgVelNEDGnss
from sbp.table import dispatch
from track_writers import S, sbp_clock, sbp_heading, sbp_position, sbp_time, sbp_velocity

from twin.drives.track.formats.sbp import read_sbp

PLACE = (63.42, 10.4, 80.0)
START_NS = int(datetime(2026, 6, 10, 8, 0, tzinfo=UTC).timestamp()) * S


def as_json(content: bytes) -> bytes:
    """The same messages as ``sbp2json`` writes them."""
    lines, at = [], 0
    while at < len(content):
        end = at + 8 + content[at + 5]
        lines.append(json.dumps(dispatch(SBP.unpack(content[at:end])).to_json_dict()))
        at = end
    return "\n".join(lines).encode()


def recording() -> bytes:
    """Three positions; a velocity and a heading at the first, and a heading between two."""
    frames = [sbp_clock(START_NS)]
    frames += [sbp_position(START_NS + i * S // 5, *PLACE) for i in range(3)]
    frames += [sbp_velocity(START_NS, 3.0, -4.0, 0.5, accuracy_mmps=(40, 90)), sbp_heading(START_NS, 143.125)]
    return b"".join([*frames, sbp_heading(START_NS + S // 10, 10.0)])


@pytest.mark.parametrize("convert", [bytes, as_json])
def test_velocity_and_heading_belong_to_the_position_of_their_time(convert: Any) -> None:
    """VEL_NED turned to east, north, up in m/s, BASELINE_HEADING in degrees; binary and JSON alike."""
    fixes = read_sbp(convert(recording()), "a", "a.sbp").fixes
    nothing = [np.nan] * 3
    np.testing.assert_allclose(fixes.velocity_mps, [[3.0, -4.0, 0.5], nothing, nothing])
    np.testing.assert_allclose(fixes.velocity_sigma_mps, [[0.04, 0.09], nothing[:2], nothing[:2]])
    np.testing.assert_allclose(fixes.heading_deg, [143.125, np.nan, np.nan])
    np.testing.assert_allclose(fixes.heading_sigma_deg, [0.5, np.nan, np.nan])


@pytest.mark.parametrize(("mode", "sigma_deg"), [(4, 0.5), (3, 3.0), (2, None), (0, None)])
def test_heading_is_as_good_as_its_solution(mode: int, sigma_deg: float | None) -> None:
    """Fixed and float solutions give a heading; a code solution and mode 0 are counted as none."""
    content = sbp_clock(START_NS) + sbp_position(START_NS, *PLACE) + sbp_heading(START_NS, 30.0, mode)
    read = read_sbp(content, "a", "a.sbp")
    np.testing.assert_array_equal(read.fixes.heading_sigma_deg, [sigma_deg or np.nan])
    reasons = counts(read.skipped)
    assert reasons == ({} if sigma_deg else {"heading without an RTK solution": 1})


def test_velocity_with_a_covariance_comes_first() -> None:
    """VEL_NED_COV says more than VEL_NED."""
    better = MsgVelNEDCov(
        tow=sbp_time(START_NS)[1], n=1000, e=0, d=0, cov_n_n=0.0009, cov_n_e=0.0, cov_n_d=0.0, cov_e_e=0.0025,
        cov_e_d=0.0, cov_d_d=0.01, n_sats=9, flags=1,
    )  # fmt: skip
    content = sbp_clock(START_NS) + sbp_position(START_NS, *PLACE) + sbp_velocity(START_NS, 9.0, 9.0, 9.0)
    fixes = read_sbp(content + better.to_binary(), "a", "a.sbp").fixes
    np.testing.assert_allclose(fixes.velocity_mps, [[0.0, 1.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(fixes.velocity_sigma_mps, [[np.sqrt(0.0017), 0.1]], rtol=1e-6)


def test_velocity_is_that_of_the_point_of_the_position() -> None:
    """An antenna's position takes VEL_NED_GNSS, never the velocity of the INS's point."""
    tow, at = sbp_time(START_NS)[1], dict(zip(("lat", "lon", "height"), PLACE, strict=True))
    antenna = MsgPosLLHGnss(tow=tow, **at, h_accuracy=10, v_accuracy=20, n_sats=9, flags=4).to_binary()
    of_antenna = MsgVelNEDGnss(tow=tow, n=2000, e=0, d=0, h_accuracy=30, v_accuracy=60, n_sats=9, flags=1)
    content = sbp_clock(START_NS) + antenna + sbp_velocity(START_NS, 9.0, 9.0, 9.0)
    assert np.isnan(read_sbp(content, "a", "a.sbp").fixes.velocity_mps).all()
    fixes = read_sbp(content + of_antenna.to_binary(), "a", "a.sbp").fixes
    np.testing.assert_allclose(fixes.velocity_mps, [[0.0, 2.0, 0.0]], atol=1e-12)


def test_velocity_faster_than_any_car_is_none() -> None:
    """A receiver that loses its lock may say anything."""
    content = sbp_clock(START_NS) + sbp_position(START_NS, *PLACE) + sbp_velocity(START_NS, 900.0, 0.0, 0.0)
    assert np.isnan(read_sbp(content, "a", "a.sbp").fixes.velocity_mps).all()
