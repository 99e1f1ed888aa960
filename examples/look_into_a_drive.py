"""Record the effect of the stepped speed feed-forward on the current within three bus cycles of 4 ms."""

import delta3_pacdrive as d3
from delta3_pacdrive import simulation
from delta3_pacdrive.recording.acquisition import Acquisition, setting

CHANNELS = ['axis1.speed_reference', 'axis1.current_reference', 'axis1.current']

for interpolation in ('linear', 'cubic'):
    robot = d3.load_parameters().replace(bus__cycle_time_s=4e-3, drive__interpolation=interpolation)
    asked = setting(
        robot, CHANNELS, rate_hz=16_000, duration_s=12e-3, trigger='axis1.speed', level=50.0, edge='rising'
    )
    records = []
    simulation.run(d3.load_program('experiment1', robot), robot, Acquisition(asked, records.append))
    speed, _, current = records[0].values.T
    print(
        f'{interpolation:6}: from {records[0].time_s[0]:.3f} s on the speed reference steps by up to '
        f'{abs(speed[1:] - speed[:-1]).max():.2f} rad/s, the current swings by {current.max() - current.min():.2f} A'
    )
