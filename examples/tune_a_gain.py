"""Show the effect of position gain and feed-forward on the TCP error of experiment 1."""

import delta3_pacdrive as d3

robot = d3.load_parameters()


def error_mm(**changes):
    """Largest TCP error of experiment 1 with some values of the drives changed."""
    changed = robot.replace(**{f'drive__{name}': value for name, value in changes.items()})
    return 1e3 * d3.simulate('experiment1', changed).meta['figures']['tcp_error_max_m']


print('K_Ppos [1/s]   with feed-forward   without')
for gain in (30.0, 60.0, 120.0):
    with_it = error_mm(position_gain_rad_s_rad=gain)
    without = error_mm(position_gain_rad_s_rad=gain, velocity_feedforward=0.0, current_feedforward=0.0)
    print(f'{gain:12.0f}   {with_it:14.3f} mm   {without:5.2f} mm')

print('margins and step responses of the same change: delta3 tune --set K_Ppos=120')
