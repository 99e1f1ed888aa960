"""The mechanism as MuJoCo knows it: bodies on hinges and slides, from lengths and masses alone."""

from delta3_pacdrive.parameters import Parameters

_POINT = 'diaginertia="1e-14 1e-14 1e-14"'  # the smallest that MuJoCo takes for a point


def _slender(length: float, mass: float) -> str:
    """Return the inertia of a slender rod along x."""
    across = mass * length**2 / 12
    return f'<inertial pos="{length / 2!r} 0 0" mass="{mass!r}" diaginertia="1e-14 {across!r} {across!r}"/>'


def mujoco_xml(robot: Parameters, *, rods: bool = False, step_s: float = 0.0) -> str:
    """Return the model: three arms on hinges with their rotors, a plate on three slides.

    Parameters
    ----------
    robot
        Its lengths and masses.
    rods
        Whether each forearm is a slender rod on two hinges at the elbow, its end the site ``end0`` to ``end2``;
        otherwise its mass is split between elbow and plate as in the thesis (4.8.1).
    step_s
        Step [s] of a simulation, in which tendons of fixed length are the forearms. Without one the tree stays open:
        who asks has to close it between the sites ``elbow0`` to ``elbow2``, or the ends, and the site ``plate``.

    """
    k, d, motor = robot.kinematics, robot.dynamics, robot.motor
    length, reach = k.upper_arm_length_m, k.forearm_length_m
    at_elbow = 0.0 if rods else d.forearm_share_at_elbow * d.forearm_mass_kg
    at_plate = 0.0 if rods else d.forearm_mass_kg - at_elbow
    armature = d.gear_ratio**2 * (motor.rotor_inertia_kg_m2 + motor.brake_inertia_kg_m2)
    arms = ''
    for i, azimuth in enumerate(k.arm_azimuth_deg):
        forearm = (
            f"""<body><joint type="hinge" axis="0 1 0"/><joint type="hinge" axis="0 0 1"/>
              {_slender(reach, d.forearm_mass_kg)}<site name="end{i}" pos="{reach!r} 0 0"/></body>"""
            if rods
            else ''
        )
        arms += f"""<body euler="0 0 {azimuth}"><body name="arm{i}" pos="{k.radius_difference_m} 0 0">
            <joint type="hinge" axis="0 1 0" armature="{armature!r}"/>{_slender(length, d.upper_arm_mass_kg)}
            <body pos="{length!r} 0 0"><inertial pos="0 0 0" mass="{d.elbow_mass_kg + at_elbow!r}" {_POINT}/>
              <site name="elbow{i}"/>{forearm}</body></body></body>"""
    slides = ''.join(f'<joint type="slide" axis="{axis}"/>' for axis in ('1 0 0', '0 1 0', '0 0 1'))
    plate_mass = d.plate_mass_kg + d.payload_mass_kg + 3.0 * at_plate
    timestep = f'timestep="{step_s!r}"' if step_s else ''
    return f"""<mujoco><compiler angle="degree"/>
        <option gravity="0 0 {-d.gravity_m_s2}" {timestep}><flag contact="disable"/></option>
        <worldbody>{arms}<body>{slides}<inertial pos="0 0 0" mass="{plate_mass!r}" {_POINT}/><site name="plate"/></body>
        </worldbody>{_tendons(robot, step_s) if step_s else ''}</mujoco>"""


def _tendons(robot: Parameters, step_s: float) -> str:
    """Return the forearms as tendons of fixed length."""
    k = robot.kinematics
    rods = ''.join(
        f'<spatial name="rod{i}"><site site="elbow{i}"/><site site="plate"/></spatial>' for i in range(3)
    )
    # as stiff as MuJoCo lets a constraint be: twice the step; lengths count from that at angles and plate of zero
    beyond = k.forearm_length_m - (k.radius_difference_m + k.upper_arm_length_m)
    ends = ''.join(
        f'<tendon tendon1="rod{i}" polycoef="{beyond!r} 0 0 0 0" solref="{2.0 * step_s!r} 1" '
        'solimp="0.9999 0.9999 0.001"/>'
        for i in range(3)
    )
    return f'<tendon>{rods}</tendon><equality>{ends}</equality>'
