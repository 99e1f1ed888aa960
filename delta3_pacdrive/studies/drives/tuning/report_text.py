"""Text of a tuning report: changes of each figure, marked better or worse, and margins of a proposal."""

import math
from functools import partial
from typing import Any

from delta3_pacdrive.studies.framework.columns import fill, shown

ALIKE = 0.005  # relative difference below which a figure counts as unchanged
BETTER, WORSE = 'better', 'worse'


def changes_in_words(before: dict[str, Any], after: dict[str, Any]) -> list[str]:
    """Return sentences that compare two variants of a summary: loops, workspace, load, noise, program."""
    return [
        *_loops(before['loops'], after['loops']),
        *_workspace(before['workspace'], after['workspace']),
        *_rejection(before['rejection'], after['rejection']),
        *_effect(before['effect'], after['effect']),
    ]


def judged_figures(before: dict[str, Any], after: dict[str, Any], proposal: dict[str, Any]) -> dict[str, str]:
    """Return ``better`` or ``worse`` for each figure that differs between a proposal and the present gains.

    Margins are minima over the workspace. Figures missing in one variant or differing by less than 0.5 % are omitted.
    """
    pairs = {
        'phase margin': (proposal['before']['phase_deg'], proposal['kept']['phase_deg'], True),
        'gain margin': (proposal['before']['gain_db'], proposal['kept']['gain_db'], True),
    }
    loops = before['loops'].get('position'), after['loops'].get('position')
    if all(loops):
        pairs['bandwidth of the position loop'] = *(loop['bandwidth_hz'] for loop in loops), True
    groups = (
        (
            'rejection',
            {'deviation under load': 'peak_rad', 'recovery from load': 'back_s', 'noise': 'noise_a'},
        ),
        ('effect', {'following error': 'following_error_max_rad', 'TCP error': 'tcp_error_max_m'}),
    )
    for group, names in groups:
        if before[group] is not None and after[group] is not None:
            pairs |= {name: (before[group][key], after[group][key], False) for name, key in names.items()}
    judged = {name: _judgement(*pair) for name, pair in pairs.items()}
    return {name: judgement for name, judgement in judged.items() if judgement}


def is_worthwhile(judged: dict[str, str]) -> bool:
    """Return whether more than one figure is better than with the present gains, or none is worse."""
    found = list(judged.values())
    return found.count(BETTER) > 1 or WORSE not in found


def _alike(old: float | None, new: float | None) -> bool:
    if old is None or new is None:
        return old is new
    return math.isclose(old, new, rel_tol=ALIKE, abs_tol=1e-12)


def _judgement(old: float | None, new: float | None, larger_is_better: bool) -> str:
    """Return ``better``, ``worse``, or an empty string if the values are equal or one is unknown."""
    if old is None or new is None or _alike(old, new):
        return ''
    return BETTER if (new > old) == larger_is_better else WORSE


def _change(old: float | None, new: float | None, spec: str, *, larger_is_better: bool) -> str:
    """Return both values of a figure and their judgement, for example ``91 Hz to 120 Hz (better)``."""
    before, after = ('none' if value is None else shown(value, spec) for value in (old, new))
    if before == after:
        return before
    judgement = _judgement(old, new, larger_is_better)
    return f'{before} to {after}' + (f' ({judgement})' if judgement else '')


_higher, _lower = partial(_change, larger_is_better=True), partial(_change, larger_is_better=False)


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
                f'{name}: crossover {_higher(old["crossover_hz"], new["crossover_hz"], ".3g =Hz")}, '
                f'phase margin {_higher(old["phase_margin_deg"], new["phase_margin_deg"], ".0f =deg")}, '
                f'gain margin {_higher(old["gain_margin_db"], new["gain_margin_db"], ".1f =dB")}'
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
        f'least margins of the cascade, as it exchanges with its plant: {_higher(old_db, new_db, ".1f =dB")}, '
        f'{_higher(old_deg, new_deg, ".0f =deg")}'
    ]


def _rejection(before: dict[str, Any] | None, after: dict[str, Any] | None) -> list[str]:
    if before is None or after is None:
        return []
    sentences = []
    if not _alike(before['peak_rad'], after['peak_rad']) or not _alike(before['back_s'], after['back_s']):
        sentences.append(
            f'a load of 1 N m moves the shaft by '
            f'{_lower(before["peak_rad"], after["peak_rad"], ".3f deg")}, for '
            f'{_lower(before["back_s"], after["back_s"], ".0f ms")}'
        )
    if not _alike(before['noise_a'], after['noise_a']):
        sentences.append(
            'noise of the encoder makes a current of '
            f'{_lower(before["noise_a"], after["noise_a"], ".1f mA")} rms'
        )
    return sentences


def _effect(before: dict[str, Any], after: dict[str, Any]) -> list[str]:
    names = 'following_error_max_rad', 'tcp_error_max_m'
    if any(effect[name] is None for effect in (before, after) for name in names):
        return []
    if all(_alike(before[name], after[name]) for name in names):
        return ['the program is followed as before']
    old, new = (effect['following_error_max_rad'] for effect in (before, after))
    return [
        f'largest following error in the program {_lower(old, new, ".2f e-3 deg")}, '
        f'TCP error {_lower(before["tcp_error_max_m"], after["tcp_error_max_m"], ".1f um")}'
    ]


def proposal_lines(proposal: dict[str, Any]) -> list[str]:
    """Return the margins of a proposal and of the present gains, and the reason if the gains are not proposed."""
    targets = proposal['targets']
    lines = [
        f'gains for {targets["phase_deg"]:g} deg and {targets["gain_db"]:g} dB over the workspace, '
        f'with 0 to {proposal["payload_kg"]:g} kg:'
    ]
    for name, title in (('before', 'before'), ('kept', 'after')):
        margins = '{phase_deg:.1f} deg ({phase_where}), {gain_db:.1f} dB ({gain_where})'
        lines.append(f'  least margins {title}: {fill(margins, proposal[name])}')
    judged = proposal['judged']
    better, worse = ([name for name, j in judged.items() if j == which] for which in (BETTER, WORSE))
    lines.append(f'  better: {", ".join(better) or "nothing"}; worse: {", ".join(worse) or "nothing"}')
    if not proposal['proposed']:
        lines.append(
            '  not proposed: at most one figure is better. Keep the present gains, or request these margins with '
            '--phase-margin or --gain-margin'
        )
    return lines


def rejection_text(rejection: dict[str, Any] | None) -> str:
    """Return the response of a drive to a load step and to encoder noise."""
    if rejection is None:
        return 'the loops are not stable'
    back = 'more than a second' if rejection['back_s'] is None else shown(rejection['back_s'], '.1f ms')
    return fill(
        'the shaft deflects by {peak_rad:.3f deg} after {peak_s:.1f ms} and returns to within 5 % after '
        f'{back}; current due to noise {{noise_a:.1f mA}} rms',
        rejection,
    )
