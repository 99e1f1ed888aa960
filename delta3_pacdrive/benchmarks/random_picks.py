"""Random time-optimal picks with blends: up, over and down between two points of the workspace."""

from typing import Any

import numpy as np

LOW_M, HIGH_M = (-0.25, -0.25, -0.9), (0.25, 0.25, -0.8)
APART_M = 0.1  # minimum horizontal distance of the two points
UP_M, PAYLOAD_KG, BLEND_M = (0.05, 0.08), (0.0, 2.0), 0.02
COOLING_S = 60.0  # after a pick, so that motor temperatures do not limit it
LIMITS = ({'jerk_m_s3': 20000.0}, {'torque_rate_n_m_s': 1000.0})


def random_pick(number: int) -> dict[str, Any]:
    """Return a pick as a program document; even numbers limit the TCP jerk, odd ones the torque rate."""
    random = np.random.default_rng(number)
    pick, place = random.uniform(LOW_M, HIGH_M), random.uniform(LOW_M, HIGH_M)
    while np.linalg.norm((place - pick)[:2]) < APART_M:
        place = random.uniform(LOW_M, HIGH_M)
    height, payload_kg = random.uniform(*UP_M), random.uniform(*PAYLOAD_KG)
    up = np.array([0.0, 0.0, height])
    return {
        'start_m': pick.tolist(),
        'payload_kg': payload_kg,
        'time_optimal': True,
        'limits': LIMITS[number % len(LIMITS)],
        'moves': [
            {'move_l': {'to_m': (pick + up).tolist(), 'blend_m': BLEND_M}},
            {'move_l': {'to_m': (place + up).tolist(), 'blend_m': BLEND_M}},
            {'move_l': {'to_m': place.tolist()}},
            {'dwell': {'time_s': COOLING_S}},
        ],
    }
