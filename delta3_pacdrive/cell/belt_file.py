"""Reader of the section ``belts`` of a cell file."""

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from delta3_pacdrive.belts.model import WIDTH_M, Belt, Camera, LightBarrier, SpeedChange, Stream
from delta3_pacdrive.cell.cell_values import (
    BELT_MAX_M_S,
    PARTS_MAX,
    REACH_M,
    delay_s,
    length_m,
    listed,
    no_parts,
    numbers,
    place_m,
    time_s,
)
from delta3_pacdrive.configuration.strict_reader import Errors, Section, refuse
from delta3_pacdrive.configuration.value_readers import number_between, one_of, whole_number_between


def read_belt(parts: tuple[str, ...], errors: Errors, name: str, value: Any, where: str) -> Belt:
    """Read one belt; ``parts`` are the part types of the cell."""
    keys = ('origin_m', 'length_m', 'encoder')
    optional = (
        'direction_rad',
        'speed',
        'jitter',
        'slip',
        'stream',
        'barrier',
        'camera',
        'window_m',
        'width_m',
    )
    fields = Section(value, where, errors, (*keys, *optional), keys)
    jitter_m_s, jitter_hz = fields.read('jitter', partial(_pair, errors, _JITTER), (0.0, 0.0))
    bits, circumference_m = fields.read('encoder', partial(_pair, errors, _ENCODER), (1.0, 1.0))
    length = fields.read('length_m', length_m, 1.0)
    return Belt(
        name=name,
        origin_m=fields.read('origin_m', place_m),
        direction_rad=fields.read('direction_rad', number_between(-math.tau, math.tau), 0.0),
        length_m=length,
        increments_per_m=2.0**bits / circumference_m,
        speed=fields.read('speed', partial(_speed, errors), ()),
        jitter_m_s=jitter_m_s,
        jitter_hz=jitter_hz,
        slip=fields.read('slip', number_between(-0.5, 0.5), 0.0),
        stream=fields.read('stream', partial(_stream, errors, parts)),
        barrier=fields.read('barrier', partial(_barrier, errors, length)),
        camera=fields.read('camera', partial(_camera, errors, length)),
        window_m=fields.read('window_m', partial(_window, length)),
        width_m=fields.read('width_m', length_m, WIDTH_M),
    )


_JITTER = {'speed_m_s': number_between(0.0, 1.0), 'frequency_hz': number_between(0.1, 100.0)}
_ENCODER: dict[str, Callable[[Any, str], float]] = {
    'bits': whole_number_between(4, 24),
    'circumference_m': number_between(0.01, REACH_M),
}


def _pair(
    errors: Errors, readers: Mapping[str, Callable[[Any, str], float]], value: Any, where: str
) -> tuple[float, float]:
    fields = Section(value, where, errors, tuple(readers), tuple(readers))
    one, two = (float(fields.read(key, read, 1.0)) for key, read in readers.items())
    return one, two


def _speed(errors: Errors, value: Any, where: str) -> tuple[SpeedChange, ...]:
    found: list[SpeedChange] = []
    for one, own, place in listed(value, where):
        with errors.noted(place):
            fields = Section(
                one, own, errors, ('after_s', 'speed_m_s', 'acceleration_m_s2'), ('after_s', 'speed_m_s')
            )
            after = fields.read('after_s', time_s, 0.0)
            if found and after <= found[-1].after_s:
                refuse(f'{own}.after_s is {after:g}, but the change before it is at {found[-1].after_s:g}')
            found.append(
                SpeedChange(
                    after,
                    fields.read('speed_m_s', number_between(-BELT_MAX_M_S, BELT_MAX_M_S), 0.0),
                    fields.read('acceleration_m_s2', number_between(0.01, 100.0), 2.0),
                )
            )
    return tuple(found)


def _stream(errors: Errors, parts: tuple[str, ...], value: Any, where: str) -> Stream:
    keys = ('part', 'count', 'spacing_m')
    fields = Section(value, where, errors, (*keys, 'spread_m', 'spread_rad', 'also'), keys)
    return Stream(
        part=fields.read('part', one_of(parts) if parts else no_parts, ''),
        count=fields.read('count', whole_number_between(1, PARTS_MAX), 1),
        spacing_m=fields.read('spacing_m', length_m, 1.0),
        spread_m=fields.read('spread_m', _spread, (0.0, 0.0)),
        spread_rad=fields.read('spread_rad', number_between(0.0, math.pi), 0.0),
        also=fields.read('also', partial(_types, parts), ()),
    )


def _types(parts: tuple[str, ...], value: Any, where: str) -> tuple[str, ...]:
    read = one_of(parts) if parts else no_parts
    return tuple(read(one, own) for one, own, _ in listed(value, where))


_spread: Callable[[Any, str], tuple[float, float]] = numbers(2, 0.0, REACH_M)  # type: ignore[assignment]


def _barrier(errors: Errors, length_m: float, value: Any, where: str) -> LightBarrier:
    fields = Section(value, where, errors, ('at_m', 'delay_s', 'bounce_s'), ('at_m',))
    return LightBarrier(
        fields.read('at_m', number_between(0.0, length_m), 0.0),
        fields.read('delay_s', delay_s, 0.0),
        fields.read('bounce_s', delay_s, 0.0),
    )


def _window(length_m: float, value: Any, where: str) -> tuple[float, float]:
    begin, end = numbers(2, 0.0, length_m)(value, where)
    if not begin < end:
        refuse(f'{where} is from {begin:g} m to {end:g} m, but must go forward')
    return begin, end


def _camera(errors: Errors, length_of_belt_m: float, value: Any, where: str) -> Camera:
    keys, shares = ('at_m', 'length_m', 'every_m'), ('missed_share', 'doubled_share')
    fields = Section(value, where, errors, (*keys, 'latency_s', 'noise_m', 'noise_rad', *shares), keys)
    share = number_between(0.0, 1.0)
    return Camera(
        at_m=fields.read('at_m', number_between(0.0, length_of_belt_m), 0.0),
        length_m=fields.read('length_m', length_m, 1.0),
        every_m=fields.read('every_m', length_m, 1.0),
        latency_s=fields.read('latency_s', delay_s, 0.0),
        noise_m=fields.read('noise_m', number_between(0.0, 0.1), 0.0),
        noise_rad=fields.read('noise_rad', number_between(0.0, math.pi), 0.0),
        missed_share=fields.read('missed_share', share, 0.0),
        doubled_share=fields.read('doubled_share', share, 0.0),
    )
