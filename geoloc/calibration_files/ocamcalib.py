"""Scaramuzza's model in files: OCamCalib's ``calib_results.txt`` and the YAML of Lafida and MultiCol-SLAM.

The two put the linear terms differently: OCamCalib's matrix ``[[c, d], [e, 1]]`` acts on (row, column), the
YAML's on (column, row), as `OcamCamera` does. One turns into the other without loss: what a factor of the
matrix changes in the plane, powers of it change back in the polynomial.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.polynomial import Polynomial

from geoloc.calibration_files.document import CalibratedCamera, Section, built, first_lines, text_lines
from geoloc.cameras import OcamCamera
from geoloc.errors import CalibrationError

_YAML_LINE = re.compile(r"Camera\.(\w+)\s*:\s*([^\s#]+)")
_MOST_COEFFICIENTS = 20
_INVERSE_FIT_PX = 1e-2
_INVERSE_DEGREES = range(5, 16)


def looks_like_ocamcalib(head: bytes) -> bool:
    """Whether a file begins like ``calib_results.txt``: a count and as many numbers, after a comment.

    Without the comment both polynomials must be so counted, and the two numbers of the centre follow: a YOLO
    row of class 7 has seven numbers as well, and so have the rows below it.
    """
    direct, inverse, centre = (line.split() for line in first_lines(head, 3))
    is_commented = head.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"#")
    return _is_counted(direct) and (is_commented or (_is_counted(inverse) and len(centre) == 2))


def _is_counted(words: Sequence[str]) -> bool:
    is_number = bool(words) and words[0].isascii() and words[0].isdigit()
    return is_number and words[0] == str(len(words) - 1) != "0"


def looks_like_ocam_yaml(head: bytes) -> bool:
    """Whether a file begins like the YAML of Lafida and MultiCol-SLAM."""
    return b"Camera.a0" in head and b"Camera.Iw" in head


def read_ocamcalib(content: bytes, where: str) -> dict[str, CalibratedCamera]:
    """Read ``calib_results.txt``: one camera, named ``camera``.

    The file's inverse polynomial is passed over: the model finds its own inverse.

    Raises
    ------
    CalibrationError
        If lines are missing, are no numbers, or make no camera.
    """
    lines = text_lines(content, where)
    if len(lines) < 5:
        raise CalibrationError(
            f"{where} has {len(lines)} lines of numbers: OCamCalib writes five (polynomial, inverse, centre,"
            " affine parameters, image size); export it again."
        )
    names = ("polynomial", "inverse polynomial", "centre", "affine parameters", "image size")
    words = {name: line.split()[: 10 * _MOST_COEFFICIENTS] for name, line in zip(names, lines, strict=False)}
    section = Section(words, where)
    count, *polynomial = section.numbers("polynomial")
    if count != len(polynomial):
        raise section.error(f"announces {count:g} coefficients and has {len(polynomial)}: export it again.")
    row, column = section.numbers("centre", 2)
    c, d, e = section.numbers("affine parameters", 3)
    height, width = section.numbers("image size", 2)
    if not 0.1 < c < 10.0:
        raise section.error(f"gives the affine parameter c as {c:g}: it is near 1; export it again.")
    return {
        "camera": CalibratedCamera(
            built(
                where,
                OcamCamera,
                width_px=section.pixels(width),
                height_px=section.pixels(height),
                cx_px=column,
                cy_px=row,
                polynomial=_scaled(polynomial, c),
                c=1.0 / c,
                d=e / c,
                e=d / c,
            )
        )
    }


def read_ocam_yaml(content: bytes, where: str) -> dict[str, CalibratedCamera]:
    """Read the YAML of Lafida and MultiCol-SLAM: one camera, named ``camera``.

    Some of these files lack the blank after a colon, so they are read line by line.

    Raises
    ------
    CalibrationError
        If something is missing, is no number, or makes no camera.
    """
    found = (_YAML_LINE.match(line) for line in text_lines(content, where))
    section = Section({match[1]: match[2] for match in found if match is not None}, where)
    count = section.number("nrpol", default=5.0)
    if count not in range(1, _MOST_COEFFICIENTS + 1):
        raise section.error(f"announces {count:g} coefficients: expected 1 to {_MOST_COEFFICIENTS}.")
    width_px, height_px = section.size("Iw", "Ih")
    return {
        "camera": CalibratedCamera(
            built(
                where,
                OcamCamera,
                width_px=width_px,
                height_px=height_px,
                cx_px=section.number("u0"),
                cy_px=section.number("v0"),
                polynomial=tuple(section.number(f"a{i}") for i in range(int(count))),
                c=section.number("c", default=1.0),
                d=section.number("d", default=0.0),
                e=section.number("e", default=0.0),
            )
        )
    }


def ocamcalib_text(model: OcamCamera) -> str:
    """Write a camera as ``calib_results.txt``, its inverse fitted to 0.01 px over the image."""
    c = 1.0 / model.c
    rows = (
        (
            "polynomial coefficients for the DIRECT mapping function",
            _counted(_scaled(model.polynomial, 1.0 / c)),
        ),
        ("polynomial coefficients for the inverse mapping function", _counted(_inverse(model, 1.0 / c))),
        ('center: "row" and "column", starting from 0 (C convention)', _texts((model.cy_px, model.cx_px))),
        ('affine parameters "c", "d", "e"', _texts((c, model.e * c, model.d * c))),
        ('image size: "height" and "width"', f"{model.height_px} {model.width_px}"),
    )
    return "\n".join(f"#{comment}\n\n{numbers}\n" for comment, numbers in rows)


def _scaled(polynomial: Sequence[float], factor: float) -> tuple[float, ...]:
    """Polynomial of the same rays over a plane that is `factor` times larger."""
    return tuple(a * factor ** (1 - i) for i, a in enumerate(polynomial))


def _inverse(model: OcamCamera, factor: float) -> tuple[float, ...]:
    """Ascending coefficients of the file's radius over the angle above the image plane, negative in front."""
    corners = np.array([[u, v] for u in (0, model.width_px) for v in (0, model.height_px)], dtype=np.float64)
    far = float(np.hypot(*(corners - [model.cx_px, model.cy_px]).T).max())
    radius = np.linspace(0.0, min(far, model.r_max_px), 400)
    depth = -sum(a * radius**i for i, a in enumerate(model.polynomial))
    angle = np.arctan2(radius, depth) - 0.5 * math.pi
    for degree in _INVERSE_DEGREES:
        fit = Polynomial.fit(angle, radius * factor, degree).convert()
        if np.abs(fit(angle) - radius * factor).max() < _INVERSE_FIT_PX:
            break
    return tuple(fit.coef.tolist())


def _counted(numbers: Sequence[float]) -> str:
    return f"{len(numbers)} {_texts(numbers)}"


def _texts(numbers: Iterable[float]) -> str:
    return " ".join(repr(float(number)) for number in numbers)
