"""Headings that receivers have from two antennas of their own, made those of the car."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from geoloc.earth.geodesy import wrap_deg
from geoloc.trajectory.heading import CourseCheck, heading_against_course
from geoloc.trajectory.poses import GnssFixes, without_headings
from twin.drives.folder.drive_toml import SETTINGS_FILE, DriveSettings


def headings_of_the_car(fixes: GnssFixes, file: str, settings: DriveSettings) -> tuple[GnssFixes, list[str]]:
    """Turn a receiver's headings by ``heading_offset_deg``, and drop them where they contradict the course.

    Parameters
    ----------
    fixes : GnssFixes
        Headings as recorded.
    file : str
        Of the recording, for messages.
    settings : DriveSettings

    Returns
    -------
    GnssFixes
    list of str
        What a user should know, one sentence each.
    """
    told = np.isfinite(fixes.heading_deg)
    if not told.any():
        return fixes, []
    offset_deg = settings.heading_offset_deg
    sigma_deg = fixes.heading_sigma_deg
    if settings.heading_sigma_deg is not None:
        sigma_deg = np.where(told, settings.heading_sigma_deg, np.nan)
    turned = replace(
        fixes, heading_deg=(fixes.heading_deg + (offset_deg or 0.0)) % 360.0, heading_sigma_deg=sigma_deg
    )
    check = heading_against_course(turned)
    if check.contradicts:
        return without_headings(turned), [_refusal(check, file, offset_deg or 0.0)]
    if not check.told and offset_deg is None:
        return turned, [_unchecked(file)]
    return turned, []


def _refusal(check: CourseCheck, file: str, offset_deg: float) -> str:
    if not check.constant:
        return (
            f"The headings of {file} do not follow the course of the car, on {check.driven_m:.0f} m: they are"
            " not used; see that the receiver's two antennas are both on this car."
        )
    side = "anticlockwise" if check.off_deg > 0.0 else "clockwise"
    mounted = float(np.round(wrap_deg(offset_deg + check.off_deg), 1)) + 0.0
    return (
        f"The headings of {file} lie {abs(check.off_deg):.1f}° {side} of the course, on"
        f" {check.driven_m:.0f} m: they are not used; if that is how the antennas are mounted, give [gnss]"
        f" heading_offset_deg = {mounted:g} in {SETTINGS_FILE}."
    )


def _unchecked(file: str) -> str:
    return (
        f"The car drives too little to hold the headings of {file} against its course: they are taken as"
        f" those of the car's nose; give [gnss] heading_offset_deg in {SETTINGS_FILE} (0 if they are)."
    )
