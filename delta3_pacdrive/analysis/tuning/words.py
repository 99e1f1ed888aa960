"""A tuning in sentences: what other gains have changed, what a proposal keeps, what disturbs a drive."""

import math
from typing import Any

ALIKE = 0.005  # of a figure, by which it may differ and still be told as unchanged


def changes_in_words(before: dict[str, Any], after: dict[str, Any]) -> list[str]:
    """Return sentences about two variants of a summary: loops, workspace, load, noise, program."""
    return [
        *_loops(before['loops'], after['loops']),
        *_workspace(before['workspace'], after['workspace']),
        *_rejection(before['rejection'], after['rejection']),
        *_effect(before['effect'], after['effect']),
    ]


def _alike(old: float | None, new: float | None) -> bool:
    if old is None or new is None:
        return old is new
    return math.isclose(old, new, rel_tol=ALIKE, abs_tol=1e-12)


def _went(old: float | None, new: float | None, form: str, factor: float = 1.0) -> str:
    """How a figure went, such as `91 Hz to 120 Hz`."""
    told = [form.format(factor * value) if value is not None else 'none' for value in (old, new)]
    return told[0] if told[0] == told[1] else f'{told[0]} to {told[1]}'


def _loops(before: dict[str, Any], after: dict[str, Any]) -> list[str]:
    sentences, same = [], []
    figures = ('crossover_hz', 'phase_margin_deg', 'gain_margin_db', 'sensitivity_peak')
    for name, old in before.items():
        new = after[name]
        if old['stable'] != new['stable']:
            sentences.append(f'{name}: {"stable now" if new["stable"] else "not stable any more"}')
        elif all(_alike(old[figure], new[figure]) for figure in figures):
            same.append(name)
        else:
            sentences.append(
                f'{name}: crossover {_went(old["crossover_hz"], new["crossover_hz"], "{:.3g} Hz")}, '
                f'phase margin {_went(old["phase_margin_deg"], new["phase_margin_deg"], "{:.0f} deg")}, '
                f'gain margin {_went(old["gain_margin_db"], new["gain_margin_db"], "{:.1f} dB")}'
            )
    if same:
        sentences.append(f'{", ".join(same)}: as before')
    return sentences


def _workspace(before: list[dict[str, Any]], after: list[dict[str, Any]]) -> list[str]:
    def least(rows: list[dict[str, Any]], figure: str) -> float | None:
        found = [row['exchanged'][figure] for row in rows if row['exchanged']['stable']]
        return min((value for value in found if value is not None), default=None)

    old_db, new_db = (least(rows, 'gain_margin_db') for rows in (before, after))
    old_deg, new_deg = (least(rows, 'phase_margin_deg') for rows in (before, after))
    if _alike(old_db, new_db) and _alike(old_deg, new_deg):
        return []
    return [
        f'least margins of the cascade, as it exchanges with its plant: {_went(old_db, new_db, "{:.1f} dB")}, '
        f'{_went(old_deg, new_deg, "{:.0f} deg")}'
    ]


def _rejection(before: dict[str, Any] | None, after: dict[str, Any] | None) -> list[str]:
    if before is None or after is None:
        return []
    sentences = []
    if not _alike(before['peak_rad'], after['peak_rad']) or not _alike(before['back_s'], after['back_s']):
        sentences.append(
            f'a load of 1 N m moves the shaft by '
            f'{_went(math.degrees(before["peak_rad"]), math.degrees(after["peak_rad"]), "{:.3f} deg")}, for '
            f'{_went(before["back_s"], after["back_s"], "{:.0f} ms", 1e3)}'
        )
    if not _alike(before['noise_a'], after['noise_a']):
        sentences.append(
            'noise of the encoder makes a current of '
            f'{_went(before["noise_a"], after["noise_a"], "{:.1f} mA", 1e3)} rms'
        )
    return sentences


def _effect(before: dict[str, Any], after: dict[str, Any]) -> list[str]:
    names = 'following_error_max_rad', 'tcp_error_max_m'
    if any(effect[name] is None for effect in (before, after) for name in names):
        return []
    if all(_alike(before[name], after[name]) for name in names):
        return ['the program is followed as before']
    old, new = (math.degrees(effect['following_error_max_rad']) for effect in (before, after))
    return [
        f'largest following error in the program {_went(old, new, "{:.2f}e-3 deg", 1e3)}, '
        f'TCP error {_went(before["tcp_error_max_m"], after["tcp_error_max_m"], "{:.1f} um", 1e6)}'
    ]


def proposal_lines(proposal: dict[str, Any]) -> list[str]:
    """Return what a proposal keeps, and what was before."""
    wanted = proposal['targets']
    lines = [
        f'gains for {wanted["phase_deg"]:g} deg and {wanted["gain_db"]:g} dB over the workspace, '
        f'with 0 to {proposal["payload_kg"]:g} kg:'
    ]
    for name in ('before', 'kept'):
        kept = proposal[name]
        told = f'{kept["phase_deg"]:.1f} deg ({kept["phase_where"]}), {kept["gain_db"]:.1f} dB ({kept["gain_where"]})'
        lines.append(f'  least margins {"before" if name == "before" else "after"}: {told}')
    return lines


def rejection_line(name: str, rejection: dict[str, Any] | None) -> str:
    """Return what disturbs a drive with one set of gains."""
    if rejection is None:
        return f'  {name:<7} the loops are not stable'
    back_s = rejection['back_s']
    back = 'more than a second' if back_s is None else f'{1e3 * back_s:.1f} ms'
    return (
        f'  {name:<7} the shaft gives way by {math.degrees(rejection["peak_rad"]):.3f} deg after '
        f'{1e3 * rejection["peak_s"]:.1f} ms, and is back within 5 % after {back}; '
        f'current by noise {1e3 * rejection["noise_a"]:.1f} mA rms'
    )
