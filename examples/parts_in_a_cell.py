"""Simulate the packaging cycle with a vacuum gripper, and find the smallest cup that loses no part."""

import yaml

import delta3_pacdrive as d3
from delta3_pacdrive.parameters import config_directory

document = yaml.safe_load((config_directory() / 'cell.yaml').read_text(encoding='utf-8'))
for diameter_mm in (45, 50, 55, 60):
    document['cup']['diameter_mm'] = diameter_mm
    told = d3.simulate('packaging', cell=document).meta['cell']
    placed, lost = told['outcomes']['placed'], told['outcomes']['lost']
    print(f'{diameter_mm} mm: {placed} placed, {lost} lost, {100 * told["hold_use_max"]:.0f} % of the force')
    for part in told['parts'][:1]:
        if part['reason']:
            print(f'  the first one: {part["reason"]}')
