"""Learn missing feed-forward torques from repetitions of a program, save them, and run the program with them."""

from pathlib import Path
from tempfile import TemporaryDirectory

import delta3_pacdrive as d3
from delta3_pacdrive import simulation
from delta3_pacdrive.planning import learned_torques as learned
from delta3_pacdrive.studies.framework.study import silent
from delta3_pacdrive.studies.learning.run import Study
from delta3_pacdrive.studies.learning.study import Settings

settings = Settings('packaging', 'model', None, repetitions=10, bandwidth_hz=80.0)
with TemporaryDirectory() as folder:
    found = Study(settings, Path(folder), 'learn_a_program', silent).learned()
    file = learned.save(found.learned, Path(folder) / 'learned.npz')
    for one in found.repetitions:
        largest, rms = 1e6 * one.tcp_error_max_m, 1e6 * one.tcp_error_rms_m
        print(f'repetition {one.number}: TCP error {largest:.1f} um, rms {rms:.1f} um')

    robot = d3.load_parameters('model')
    trace = simulation.run(d3.load_program('packaging', robot), robot, learned=learned.load(file))
figures = trace.meta['figures']
print(
    f'with the file: {1e6 * figures["tcp_error_max_m"]:.1f} um, rms {1e6 * figures["tcp_error_rms_m"]:.1f} um'
)
