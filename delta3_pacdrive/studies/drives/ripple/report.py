"""Report of the ripple: JSON document, text and table."""

from typing import Any

from delta3_pacdrive.studies.drives.ripple.cases import Case
from delta3_pacdrive.studies.drives.ripple.study import Results, Settings
from delta3_pacdrive.studies.framework.report_folder import Table

TABLE = 'ripple.csv'
_AXES = (1, 2, 3)
# key of the document, attribute of a case
_OF_AXES = {
    'at_current_peak_a': 'at_peak_a',
    'at_current_rms_a': 'at_rms_a',
    'current_peak_a': 'peak_a',
    'current_rms_a': 'rms_a',
    'jerk_rad_s3': 'jerk_rad_s3',
}


def summary(found: Results, settings: Settings) -> dict[str, Any]:
    """Return the results, ready for JSON."""
    return {
        'program': found.program,
        'axis': found.axis,
        'shown_s': found.shown_s,
        'cycle_times_s': list(settings.cycle_times_s),
        'cases': [_of_case(case) for case in found.cases],
    }


def _of_case(case: Case) -> dict[str, Any]:
    return {
        'cycle_time_s': case.cycle_time_s,
        'interpolation': case.interpolation,
        'set_point_delay_s': case.delay_s,
        **{key: getattr(case, name) for key, name in _OF_AXES.items()},
        'tcp_error_max_m': case.tcp_error_max_m,
        'tcp_error_rms_m': case.tcp_error_rms_m,
    }


def tables(found: Results) -> list[Table]:
    """Return the table of all cases and axes."""
    rows = []
    for case in found.cases:
        for axis in _AXES:
            row: dict[str, Any] = {
                'cycle time [s]': case.cycle_time_s,
                'interpolation': case.interpolation,
                'axis': axis,
                'set-point delay [s]': case.delay_s,
            }
            units = ('[A]',) * 4 + ('[rad/s3]',)
            titles = ('AT peak', 'AT rms', 'peak', 'rms', 'jerk')
            for title, unit, name in zip(titles, units, _OF_AXES.values(), strict=True):
                row[f'{title} {unit}'] = getattr(case, name)[axis - 1]
            row |= {'TCP error max [m]': case.tcp_error_max_m, 'TCP error rms [m]': case.tcp_error_rms_m}
            rows.append(row)
    return [Table.of_rows(TABLE, rows)]


def text(document: dict[str, Any]) -> list[str]:
    """Return one line of text per case, for the axis shown in the figures."""
    i = document['axis'] - 1
    lines = [
        f'{document["program"]}, motor {document["axis"]}',
        '',
        f'{"":>14} {"delay":>8} {"current in the AT":>18} {"all samples":>18} {"jerk > 100 Hz":>14} {"TCP error":>16}',
        f'{"":>14} {"ms":>8} {"peak / rms A":>18} {"peak / rms A":>18} {"rad/s3":>14} {"max / rms mm":>16}',
    ]
    for case in document['cases']:
        in_at = f'{case["at_current_peak_a"][i]:.2f} / {case["at_current_rms_a"][i]:.2f}'
        every = f'{case["current_peak_a"][i]:.2f} / {case["current_rms_a"][i]:.2f}'
        error = f'{1e3 * case["tcp_error_max_m"]:.3f} / {1e3 * case["tcp_error_rms_m"]:.3f}'
        name = f'{1e3 * case["cycle_time_s"]:g} ms {case["interpolation"]}'
        lines.append(
            f'{name:>14} {1e3 * case["set_point_delay_s"]:8.2f} {in_at:>18} {every:>18} '
            f'{case["jerk_rad_s3"][i]:14.0f} {error:>16}'
        )
    return [
        *lines,
        '',
        f'the bus cycle in the figures begins {document["shown_s"]:.3f} s after the start of the program',
        '',
    ]
