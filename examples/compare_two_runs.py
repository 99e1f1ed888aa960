"""Compare a program on the nominal and on the built robot, and write a report with both runs."""

import sys
from pathlib import Path

from delta3_pacdrive.studies.framework.provenance import Provenance
from delta3_pacdrive.studies.report_page import page
from delta3_pacdrive.studies.runs import run_comparison, runs

output = Path(sys.argv[1] if len(sys.argv) > 1 else 'nominal_and_built.html')

nominal, built = runs.load('experiment1'), runs.load('experiment1', 'built')
found = run_comparison.compare(nominal, built)

print(f'aligned by {found.alignment.by}, correlation {found.alignment.correlation:.5f}')
for name in ('tcp_actual', 'tcp_true'):
    figure = found.figures[name]
    print(f'{name}: {1e3 * figure.rms:.3f} mm rms apart, at most {1e3 * figure.largest:.3f} mm')
for move, other in found.moves:
    peaks = [run_comparison.move_figures(*each).current_peak_a for each in ((nominal, move), (built, other))]
    print(f'move {move.number}: {peaks[0]:.2f} A and {peaks[1]:.2f} A; limited by {move.limited_by}')

origin = Provenance.of('python compare_two_runs.py', nominal.robot, inputs=[nominal.origin, built.origin])
page.write(output, [nominal, built], origin)
print(f'{output}: {output.stat().st_size / 1e6:.1f} MB')
