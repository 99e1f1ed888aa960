"""The readout next to the picture as HTML: state of robot and bus, bars of each axis, the fault."""

import html
import math
from collections.abc import Sequence
from dataclasses import dataclass

from delta3_pacdrive.control.motion_state import UNDER_WAY
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters, numbered
from delta3_pacdrive.view.values import DriveFacts, Facts, InputFacts, Instant, TurnInstant

GREEN, AMBER, RED, GREY, BLUE = '#2f9e5b', '#e08a00', '#d92d3a', '#868e96', '#3a86ff'
STATE_COLOURS = {
    'idle': GREEN,
    'moving': BLUE,
    'steered': BLUE,
    'stopping': AMBER,
    'stopped': AMBER,
    'error': RED,
    'commissioning': AMBER,
    'playing': BLUE,
}
SHOWS_MOVE = (*UNDER_WAY, 'playing', 'paused')
DRIVE_COLOURS = {'ENABLED': GREEN, 'ENABLING': AMBER, 'PROCEDURE': AMBER, 'FAULT': RED}
COLUMNS = 'repeat(auto-fit,minmax(150px,1fr))'  # of bars: one column on a phone
CUT = 'white-space:nowrap;overflow:hidden;text-overflow:ellipsis'
HIGH, TOO_HIGH = 0.6, 0.9  # shares of a limit above which a bar is amber and red


@dataclass(frozen=True)
class Scales:
    """Full scale of the bars: motor limits, and the following error [rad] at which a drive warns."""

    torque_n_m: float
    current_a: float
    lag_rad: float

    @staticmethod
    def of(parameters: Parameters) -> 'Scales':
        """Return the scales of a robot; the following error is that of the arm."""
        motor = parameters.motor
        return Scales(
            motor.torque_constant_n_m_a * motor.peak_current_a,
            motor.peak_current_a,
            parameters.drive.following_error_limit_rad / parameters.dynamics.gear_ratio,
        )


def chip(text: str, colour: str) -> str:
    """Return a text in a coloured box."""
    return (
        f'<span style="background:{colour};color:#fff;border-radius:4px;padding:1px 7px;font-weight:600;'
        f'white-space:nowrap">{html.escape(text)}</span>'
    )


def _boxed(content: str) -> str:
    style = 'padding:4px 12px;font-size:13px;line-height:1.5;font-variant-numeric:tabular-nums'
    return f'<div style="{style}">{content}</div>'


def status(facts: Facts, tcp_m: Floats | None, turns: Sequence[TurnInstant] = ()) -> str:
    """Return the state of robot and bus."""
    if not facts.state:
        waiting = html.escape(facts.waiting or 'waiting for a robot')
        return _boxed(f'{chip("no robot", GREY)} <span style="opacity:.75">{waiting}</span>')
    rows = _of_recording(facts) if facts.recording else _of_robot(facts)
    if tcp_m is not None:
        x, y, z = (1e3 * tcp_m).tolist()
        rows.append(_pairs(('TCP', f'{x:.2f}, {y:.2f}, {z:.2f} mm')))
    for number, turn in enumerate(turns):
        angle, error = math.degrees(turn.angle_rad), math.degrees(turn.error_rad)
        rows.append(
            _pairs((numbered('tool', number, ' '), f'{angle:.2f} deg'), ('error', f'{error:.3f} deg'))
        )
    if facts.moves and facts.state in SHOWS_MOVE:
        left = () if facts.remaining_s is None else (('left', f'{facts.remaining_s:.1f} s'),)
        rows.append(_pairs(('move', f'{facts.move + 1} of {facts.moves}'), *left))
    outputs = ' '.join(str(n) for n in range(8) if facts.outputs >> n & 1)
    queue = () if facts.recording else (('queue', f'{facts.queue}'),)
    payload = () if facts.payload_kg is None else (('payload', f'{facts.payload_kg:g} kg'),)
    rows.append(_pairs(*queue, ('outputs', outputs or 'none'), *payload))
    if facts.inputs:
        rows.append(_inputs(facts.inputs))
    if facts.controller:
        rows.append(f'<span style="opacity:.65">controller</span> <b>{html.escape(facts.controller)}</b>')
    if facts.operator:
        operator = html.escape(facts.operator)
        rows.append(
            f'<span style="opacity:.65">control</span>&nbsp;<b style="overflow-wrap:anywhere">{operator}</b>'
        )
    rows += [html.escape(text) for text in (facts.working, facts.waiting) if text]
    if facts.fault:
        rows.append(alarm(facts.fault))
    return _boxed('<br>'.join(rows))


def _of_robot(facts: Facts) -> list[str]:
    torque = chip('torque on', GREEN) if facts.in_torque else chip('torque off', GREY)
    return [
        f'{chip(facts.state, STATE_COLOURS.get(facts.state, GREY))} {torque} {chip(facts.phase, GREY)}',
        _pairs(
            ('cycle', f'{facts.cycle}'),
            ('bus time', f'{facts.bus_time_s:.2f} s'),
            ('override', f'{100.0 * facts.override:.4g} %'),
            ('overruns', f'{facts.overruns}'),
            ('lost AT', f'{facts.lost_telegrams}'),
        ),
    ]


def _of_recording(facts: Facts) -> list[str]:
    return [
        f'{chip(facts.state, STATE_COLOURS.get(facts.state, GREY))} <b>{html.escape(facts.recording)}</b>',
        _pairs(
            ('cycle', f'{facts.cycle}'),
            ('time', f'{facts.bus_time_s:.3f} s'),
            ('speed', f'{facts.override:g}'),
        ),
    ]


def _inputs(inputs: Sequence[InputFacts]) -> str:
    """Return the states of the inputs, with forced ones marked."""
    found = [
        f'<span style="white-space:nowrap">{html.escape(one.name)}&nbsp;{_switch(one)}</span>'
        for one in inputs
    ]
    return f'<span style="opacity:.65">inputs</span>&ensp;{" &ensp;".join(found)}'


def _switch(one: InputFacts) -> str:
    """Return the state of an input, with a mark if it is forced."""
    colour = AMBER if one.forced else GREEN if one.on else GREY
    return chip(f'{"on" if one.on else "off"}{", set" if one.forced else ""}', colour)


def input_row(one: InputFacts) -> str:
    """Return name and state of an input."""
    return _boxed(f'<b>{html.escape(one.name)}</b>&ensp;{_switch(one)}')


def alarm(sentence: str) -> str:
    """Return a conspicuous alarm message."""
    return (
        f'<div role="alert" style="background:{RED};color:#fff;border-radius:6px;padding:6px 10px;margin-top:4px;'
        f'font-weight:600">{html.escape(sentence)}</div>'
    )


def _pairs(*pairs: tuple[str, str]) -> str:
    return ' &ensp;'.join(
        f'<span style="opacity:.65">{name}</span>&nbsp;<b style="white-space:nowrap">{value}</b>'
        for name, value in pairs
    )


def bars(instant: Instant, drives: Sequence[DriveFacts], scales: Scales) -> str:
    """Return bars of torque, current, following error and I2t of each axis, with the states of drive and brake."""
    rows = []
    for i, drive in enumerate(drives):
        torque, current = float(instant.torque_n_m[i]), float(instant.current_a[i])
        lag, overload = float(instant.lag_rad[i]), float(instant.overload[i])
        head = [f'<b>axis {i + 1}</b>']
        if drive.state:
            head.append(chip(drive.state.lower().replace('_', ' '), DRIVE_COLOURS.get(drive.state, GREY)))
        if drive.brake:
            head.append(chip(f'brake {drive.brake}', GREEN if drive.brake == 'free' else GREY))
        head += [chip(warning, AMBER) for warning in drive.warnings]
        rows.append(f'<div style="margin-top:5px">{" ".join(head)}</div>')
        rows.append(
            f'<div style="display:grid;grid-template-columns:{COLUMNS};column-gap:14px">'
            + _bar('torque', torque / scales.torque_n_m, f'{torque:.2f} N m')
            + _bar('current', current / scales.current_a, f'{current:.2f} A')
            + _bar('following error', lag / scales.lag_rad, f'{57.29577951 * lag:.4f} deg')
            + _bar('I2t', overload, f'{100.0 * overload:.0f} %', signed=False)
            + '</div>'
        )
    return _boxed(''.join(rows))


def _bar(name: str, share: float, text: str, signed: bool = True) -> str:
    """Return a bar that grows from the middle or the left, coloured by its share of the limit."""
    size = min(abs(share), 1.0)
    colour = RED if size >= TOO_HIGH else AMBER if size >= HIGH else BLUE
    if signed:
        width = 50.0 * size
        left = 50.0 if share >= 0.0 else 50.0 - width
        style = 'position:absolute;left:50%;top:0;width:1px;height:100%;background:currentColor;opacity:.4'
        middle = f'<div style="{style}"></div>'
    else:
        width, left, middle = 100.0 * size, 0.0, ''
    return (
        f'<div><div style="display:flex;justify-content:space-between;gap:8px;font-size:11px;line-height:1.25">'
        f'<span style="opacity:.65;min-width:0;{CUT}">{name}</span><span style="white-space:nowrap">{text}</span></div>'
        '<div style="position:relative;height:7px;border-radius:3px;overflow:hidden;'
        'background:rgba(128,128,128,.25)">'
        f'<div style="position:absolute;left:{left:.1f}%;width:{width:.1f}%;height:100%;background:{colour}"></div>'
        f'{middle}</div></div>'
    )


def answers(sentences: Sequence[tuple[str, bool]]) -> str:
    """Return recent replies, newest first, rejections in red."""
    if not sentences:
        return ''
    rows = [
        f'<div style="{"color:" + RED + ";font-weight:600" if refused else "opacity:.85"}">{html.escape(text)}</div>'
        for text, refused in reversed(sentences)
    ]
    return _boxed(''.join(rows))


def copied(text: str, label: str) -> str:
    """Return a text with a copy button."""
    copy = 'navigator.clipboard.writeText(this.previousElementSibling.textContent);this.textContent=&quot;copied&quot;'
    return _boxed(
        '<pre style="margin:0 0 4px;padding:6px 8px;border-radius:4px;background:rgba(128,128,128,.18);font-size:11px;'
        f'max-height:180px;overflow:auto;white-space:pre">{html.escape(text)}</pre>'
        f'<button onclick="{copy}" style="cursor:pointer;font-size:12px;padding:3px 10px;border-radius:4px;'
        f'border:1px solid rgba(128,128,128,.6);background:transparent;color:inherit">{html.escape(label)}</button>'
    )
