"""Compare the TCP error with and without feed-forward of the complete model torque."""

import delta3_pacdrive as d3

for program in ('experiment1', 'packaging'):
    for name in ('delta3', 'model'):
        figures = d3.simulate(program, d3.load_parameters(name)).meta['figures']
        print(
            f'{program:11} {name:6}: TCP error {1e3 * figures["tcp_error_max_m"]:.3f} mm, '
            f'rms {1e3 * figures["tcp_error_rms_m"]:.3f} mm, current {max(figures["current_peak_a"]):.2f} A, '
            f'rms {max(figures["current_rms_a"]):.2f} A'
        )

trace = d3.simulate('packaging', d3.load_parameters('model'))
print(f'largest torque that it commands: {abs(trace["torque_command"]).max():.2f} N m')
