"""Report of the ripple: JSON document, text and table."""

from typing import Any

from delta3_pacdrive.studies.drives.ripple.study import Results, Settings
from delta3_pacdrive.studies.framework.columns import TextColumn, csv_table, fill, text_table, to_dict
from delta3_pacdrive.studies.framework.report_folder import Table

TABLE = 'ripple.csv'


def summary(found: Results, settings: Settings) -> dict[str, Any]:
    """Return the results, ready for JSON."""
    return {
        'program': found.program,
        'axis': found.axis,
        'shown_s': found.shown_s,
        'cycle_times_s': list(settings.cycle_times_s),
        'cases': to_dict(found.cases),
    }


def tables(found: Results) -> list[Table]:
    """Return the table of all cases and axes."""
    return [csv_table(TABLE, found.cases, rows_each=3)]


def text(document: dict[str, Any]) -> list[str]:
    """Return one line of text per case, for the axis shown in the figures."""
    i = document['axis'] - 1
    columns = [
        TextColumn('', '{cycle_time_s:g ms} {interpolation}'),
        TextColumn('delay\nms', '{set_point_delay_s:.2f in ms}'),
        TextColumn(
            'current in the AT\npeak / rms A',
            f'{{at_current_peak_a[{i}]:.2f}} / {{at_current_rms_a[{i}]:.2f}}',
        ),
        TextColumn('all samples\npeak / rms A', f'{{current_peak_a[{i}]:.2f}} / {{current_rms_a[{i}]:.2f}}'),
        TextColumn('jerk > 100 Hz\nrad/s3', f'{{jerk_rad_s3[{i}]:.0f}}'),
        TextColumn('TCP error\nmax / rms mm', '{tcp_error_max_m:.3f in mm} / {tcp_error_rms_m:.3f in mm}'),
    ]
    return [
        f'{document["program"]}, motor {document["axis"]}',
        '',
        *text_table(document['cases'], columns),
        '',
        fill('the bus cycle in the figures begins {shown_s:.3f s} after the start of the program', document),
        '',
    ]
