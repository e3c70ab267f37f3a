"""Small turns of a body, many at once, and their derivatives."""

from __future__ import annotations

import numpy as np

from geoloc.arrays import FloatArray


def into(rotation: FloatArray, vector: FloatArray) -> FloatArray:
    """Vectors (n, 3) seen from the frames whose axes are the columns of ``rotation (n, 3, 3)``."""
    return np.asarray(np.einsum("nji,nj->ni", rotation, vector))


def turned_back(vector: FloatArray, angle_rad: FloatArray) -> FloatArray:
    """Vectors (n, 3) seen from a body that has turned left by small angles about its z."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    x, y, z = vector.T
    return np.stack([cos * x + sin * y, cos * y - sin * x, z], axis=1)


def turned_matrix(rotation: FloatArray, angle_rad: FloatArray) -> FloatArray:
    """``rotation @ Rz(angle)``."""
    cos, sin = np.cos(angle_rad)[:, None], np.sin(angle_rad)[:, None]
    x, y, z = (rotation[:, :, axis] for axis in range(3))
    return np.stack([cos * x + sin * y, cos * y - sin * x, z], axis=2)


def rotation_matrix_back(vector: FloatArray) -> FloatArray:
    """Rotation matrices ``exp(-[v]×)`` (n, 3, 3) by Rodrigues' formula."""
    angle = np.linalg.norm(vector, axis=1)
    a = np.sinc(angle / np.pi)
    b = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    cross = cross_matrix(vector)
    return np.asarray(np.eye(3) - a[:, None, None] * cross + b[:, None, None] * (cross @ cross))


def rotated(vector: FloatArray, turn: FloatArray) -> FloatArray:
    """Vectors seen from frames that have turned by rotation vectors: ``exp(-[turn]×) vector``."""
    return np.asarray(np.einsum("nij,nj->ni", rotation_matrix_back(turn), vector))


def rotation_derivative(rotated: FloatArray, turn: FloatArray) -> FloatArray:
    """Derivative (n, 3, 3) of `rotated` by the rotation vector, to second order in it."""
    half = np.eye(3) - 0.5 * cross_matrix(turn)
    return np.asarray(cross_matrix(rotated) @ half)


def cross_matrix(vector: FloatArray) -> FloatArray:
    """``[v]×`` (n, 3, 3): ``[v]× w = v × w``."""
    x, y, z = vector.T
    o = np.zeros_like(x)
    return np.stack([o, -z, y, z, o, -x, -y, x, o], axis=1).reshape(-1, 3, 3)
