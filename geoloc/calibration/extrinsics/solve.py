"""Least squares over a network: robust, with the noise of each camera found from its residuals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy import sparse

from geoloc.arrays import FloatArray
from geoloc.calibration.extrinsics.network import Network, NetworkEquations, NetworkState
from geoloc.calibration.extrinsics.observations import Sighting, Sigmas, Tag

_HUBER = 2.5
_MAX_STEPS = 100
_SETTLED = 1e-6
_MOST_DAMPING = 1e12
_NOISE_ROUNDS = 4
_LEAST_SIGMA_PX = 0.05
"""Rays are not known better than that: the error of the intrinsics is in every corner of a camera."""


def adjust_network(
    sightings: Sequence[Sighting],
    tags: Mapping[int, Tag],
    sigmas: Sigmas,
    state: NetworkState,
    *,
    robust: bool,
) -> tuple[Network, NetworkState]:
    """Solve with each camera's corner sigma made equal to what its residuals say.

    By their median if `robust`, so that a tag which does not fit cannot hide in the noise that it makes.
    """
    corner_px = {s.camera: sigmas.corner_px for s in sightings}
    for _ in range(_NOISE_ROUNDS):
        network = Network(sightings, tags, sigmas, corner_px)
        state = solve_network(network, state)
        found = {
            camera: max(px, _LEAST_SIGMA_PX)
            for camera, px in _noise_px(network, state, robust=robust).items()
        }
        settled = all(abs(found[camera] / px - 1.0) < 0.02 for camera, px in corner_px.items())
        corner_px = found
        if settled:
            break
    return Network(sightings, tags, sigmas, corner_px), state


def solve_network(network: Network, state: NetworkState) -> NetworkState:
    """Levenberg and Marquardt's method on the robust cost."""
    equations = network.equations(state)
    damping, cost = 1e-4, _cost(equations, network)
    for _ in range(_MAX_STEPS):
        normal, gradient = _normal(equations, network)
        scaled = np.diag(normal)
        while True:
            step = np.asarray(
                -np.linalg.solve(normal + np.diag(damping * scaled), gradient), dtype=np.float64
            )
            tried = network.moved(state, step)
            trial = network.equations(tried)
            trial_cost = _cost(trial, network)
            if trial_cost <= cost or damping > _MOST_DAMPING:
                break
            damping *= 10.0
        if damping > _MOST_DAMPING:
            break
        gain = cost - trial_cost
        state, equations, cost = tried, trial, trial_cost
        damping = max(damping / 10.0, 1e-12)
        if gain <= _SETTLED * max(cost, 1.0):
            break
    return state


def angle_step(
    network: Network, state: NetworkState, cameras: Sequence[str]
) -> tuple[FloatArray, FloatArray]:
    """How much larger each camera's angles from its optical axis should be, all else free.

    One step of Gauss and Newton with a factor a camera beside the network's own unknowns: what a wrong
    focal length does.

    Returns
    -------
    part, sigma : float64 (n_cameras,)
        Part of the angle, one sigma.
    """
    equations = network.equations(state)
    columns = np.zeros((len(equations.residual), len(cameras)))
    for row, sighting in enumerate(network.sightings):
        slope = np.einsum("kij,kj->ki", sighting.px_from_ray, _by_angle(sighting.ray))
        at = slice(8 * row, 8 * row + 8)
        columns[at, cameras.index(sighting.camera)] = -slope.ravel() / network.corner_px[sighting.camera]
    whole = sparse.csr_matrix(sparse.hstack([equations.jacobian, sparse.csr_matrix(columns)]))
    normal, gradient = _normal(NetworkEquations(equations.residual, whole), network)
    covariance = np.linalg.inv(normal)
    n = len(cameras)
    return -(covariance @ gradient)[-n:], np.sqrt(np.diag(covariance)[-n:])


def _by_angle(ray: FloatArray) -> FloatArray:
    """Derivative (k, 3) of unit rays by the relative error of their angle from the optical axis."""
    across = np.linalg.norm(ray[:, :2], axis=1, keepdims=True)
    outward = ray[:, :2] / np.maximum(across, 1e-12)
    return np.asarray(np.arctan2(across, ray[:, 2:]) * np.hstack([ray[:, 2:] * outward, -across]))


def _weights(equations: NetworkEquations, network: Network) -> FloatArray:
    """Huber's weights of the corners by their distance in sigmas; priors count whole."""
    n = 8 * len(network.sightings)
    distance = np.linalg.norm(equations.residual[:n].reshape(-1, 2), axis=1)
    weight = np.minimum(1.0, _HUBER / np.maximum(distance, 1e-12))
    return np.concatenate([np.repeat(weight, 2), np.ones(len(equations.residual) - n)])


def _cost(equations: NetworkEquations, network: Network) -> float:
    n = 8 * len(network.sightings)
    distance = np.linalg.norm(equations.residual[:n].reshape(-1, 2), axis=1)
    robust = np.where(distance <= _HUBER, 0.5 * distance**2, _HUBER * (distance - 0.5 * _HUBER))
    return float(robust.sum() + 0.5 * (equations.residual[n:] ** 2).sum())


def _normal(equations: NetworkEquations, network: Network) -> tuple[FloatArray, FloatArray]:
    weighted = sparse.diags_array(_weights(equations, network)) @ equations.jacobian
    normal = np.asarray((weighted.T @ equations.jacobian).todense())
    return normal, np.asarray(weighted.T @ equations.residual)


def _noise_px(network: Network, state: NetworkState, *, robust: bool) -> dict[str, float]:
    """Sigma of a corner's coordinate in each camera: residuals over the redundancy that they have.

    The redundancy of corners is their number less the trace of ``J C J'``: what the unknowns took up.
    """
    equations = network.equations(state)
    n = 8 * len(network.sightings)
    normal, _ = _normal(equations, network)
    corners = equations.jacobian[:n]
    taken = np.asarray(corners.multiply(np.asarray(corners @ np.linalg.inv(normal))).sum(axis=1)).ravel()
    squares = _weights(equations, network)[:n] * equations.residual[:n] ** 2
    camera = np.repeat([s.camera for s in network.sightings], 8)
    found = {}
    for name, px in network.corner_px.items():
        mine = camera == name
        squared = squares[mine].sum()
        if robust:
            # By the median: 0.6745 is that of the absolute standard normal.
            squared = mine.sum() * (np.median(np.abs(equations.residual[:n][mine])) / 0.6745) ** 2
        redundancy = max(float((1.0 - taken)[mine].sum()), 1.0)
        found[name] = px * float(np.sqrt(squared / redundancy))
    return found


def covariance_of(network: Network, state: NetworkState) -> FloatArray:
    """Covariance of all unknowns (k, k), in the order of the network's columns."""
    normal, _ = _normal(network.equations(state), network)
    return np.asarray(np.linalg.inv(normal), dtype=np.float64)
