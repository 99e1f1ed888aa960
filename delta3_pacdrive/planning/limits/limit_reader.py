"""Readers of move limits in program files."""

import math
from typing import Any

from delta3_pacdrive.configuration.strict_reader import Section, refuse
from delta3_pacdrive.configuration.value_readers import number, number_between
from delta3_pacdrive.planning.limits.limits import Limits

BLEND_MIN_M, BLEND_MAX_M = 1e-4, 1.0
LIMIT_MIN, LIMIT_MAX = 1e-6, 1e9  # for speed, acceleration and jerk
TCP_LIMIT_KEYS = ('speed_m_s', 'acceleration_m_s2', 'jerk_m_s3')
LIMIT_KEYS = (*TCP_LIMIT_KEYS, 'torque_rate_n_m_s')


def given_limits(fields: Section, tcp_speed_limit_m_s: float) -> dict[str, float]:
    """Read the limits given in a section, by key; rejects speeds above the TCP speed limit of the robot [m/s]."""

    def speed(value: Any, where: str) -> float:
        found = _limit(value, where)
        if found > tcp_speed_limit_m_s:
            refuse(
                f'{where} is {found}, but must not exceed motion.tcp_speed_limit_m_s ({tcp_speed_limit_m_s})'
            )
        return found

    return {
        key: fields.read(key, speed if key == 'speed_m_s' else _limit) for key in LIMIT_KEYS if key in fields
    }


def limits_of(given: dict[str, float], defaults: Limits, time_optimal: bool) -> Limits:
    """Complete TCP limits with defaults.

    Speed and acceleration of a time-optimal move default to unlimited, its jerk only if a torque rate is given.
    """
    if time_optimal:
        jerk = math.inf if 'torque_rate_n_m_s' in given else defaults.jerk_m_s3
        defaults = Limits(math.inf, math.inf, jerk)
    return Limits(*(given.get(key, getattr(defaults, key)) for key in TCP_LIMIT_KEYS))


def blend(value: Any, where: str) -> float:
    """Read the distance before a corner at which a blend starts [m]; 0: no blend."""
    found = number_between(0.0, BLEND_MAX_M)(value, where)
    if 0.0 < found < BLEND_MIN_M:
        refuse(f'{where} is {found:g}, but must be 0 or at least {BLEND_MIN_M:g}')
    return found


def _limit(value: Any, where: str) -> float:
    limit = number(value, where)
    if not limit > 0.0 or (math.isinf(limit) and 'jerk_' not in where.rpartition('.')[2]):
        refuse(f'{where} is {limit}, but must be a positive number')
    if not LIMIT_MIN <= limit <= LIMIT_MAX and not math.isinf(limit):
        refuse(f'{where} is {limit:g}, but must be between {LIMIT_MIN:g} and {LIMIT_MAX:g}')
    return limit
