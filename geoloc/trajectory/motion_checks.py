"""x"""

from geoloc.trajectory.motion_readings import MotionReadings


def checked_readings(motion, knots, knot_ns, best):
    return MotionReadings.of(motion, int(knot_ns[0]))
