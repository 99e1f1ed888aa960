"""Tests of masses and torques (thesis 4.8, 4.9) against independent point masses and MuJoCo."""

import math

import numpy as np
import pytest

from delta3_pacdrive import dynamics, kinematics
from second_engine import closed_chain, engine_of

SEED = 20090418
PRINTED = 1e-9  # the reference values have nine decimals
THETA = np.radians([10.0, 25.0, 40.0])
THETADOT = np.array([2.0, -1.0, 1.5])
THETADDOT = np.array([10.0, -20.0, 30.0])
STEP = 2e-4  # of differences of fourth order: step^4 of the motion and rounding/step
LAGRANGE = 1e-8  # [N m]; difference quotients of energies of some 10 J
POWER = 1e-7  # [W]; the same, times speeds of up to 8 rad/s
ENGINE = 1e-12  # relative: two solvers of the same equations, rounding times condition numbers below 1e3 (4e-14 seen)


def states(count, speed=4.0, acceleration=60.0):
    """Angles within the control limits, speeds and accelerations: three arrays (count, 3)."""
    print(f'seed {SEED}')
    random = np.random.default_rng(SEED)
    theta = np.radians(random.uniform(-45.0, 95.0, (count, 3)))
    scale = random.uniform(-1.0, 1.0, (2, count, 3))
    return theta, speed * scale[0], acceleration * scale[1]


def derivative(function, step=STEP):
    """Central difference of fourth order of a function of one variable at 0."""
    inner, outer = function(step) - function(-step), function(2.0 * step) - function(-2.0 * step)
    return (8.0 * inner - outer) / (12.0 * step)


def elbow_and_outward(theta, robot):
    """Elbows and hips of an angle triple, each (3, 3); angles may be complex."""
    k = robot.kinematics
    azimuth = 2.0 * np.pi / 3.0 * np.arange(3)
    outward = np.stack([np.cos(azimuth), np.sin(azimuth), 0.0 * azimuth], axis=-1)
    hip = (k.base_radius_m - k.plate_radius_m) * outward
    down = np.array([0.0, 0.0, -1.0])
    arm = np.cos(theta)[:, None] * outward + np.sin(theta)[:, None] * down
    return hip + k.upper_arm_length_m * arm, hip


def plate(theta, robot):
    """Plate point of an angle triple: two planes of equal distance to the elbows, then the lower root on their line."""
    c, _ = elbow_and_outward(theta, robot)
    planes = 2.0 * (c[1:] - c[0])
    sides = (c[1:] ** 2).sum(axis=1) - (c[0] ** 2).sum()
    xy_at_zero = np.linalg.solve(planes[:, :2], sides)
    xy_per_z = np.linalg.solve(planes[:, :2], -planes[:, 2])
    origin, direction = np.append(xy_at_zero, 0.0) - c[0], np.append(xy_per_z, 1.0)
    a, b = direction @ direction, direction @ origin
    z = (-b - np.sqrt(b * b - a * (origin @ origin - robot.kinematics.forearm_length_m**2))) / a
    return np.append(xy_at_zero + z * xy_per_z, z)


def point_masses(theta, robot, rods=False):
    """Masses (n,) and positions (n, 3): each upper arm by Simpson's rule, elbows, forearms' shares, plate.

    The forearms' masses are split, or those of ``rods`` by Simpson's rule, exact for uniform ones.
    """
    d = robot.dynamics
    elbow, hip = elbow_and_outward(theta, robot)
    share = d.forearm_mass_kg * (1.0 / 6.0 if rods else d.forearm_share_at_elbow)
    at_plate = share if rods else d.forearm_mass_kg - share
    masses, positions = [], []
    for i in range(3):
        masses += [d.upper_arm_mass_kg / 6.0, d.upper_arm_mass_kg / 1.5, d.upper_arm_mass_kg / 6.0]
        positions += [hip[i], 0.5 * (hip[i] + elbow[i]), elbow[i]]
        masses += [d.elbow_mass_kg + share]
        positions += [elbow[i]]
        masses += [d.forearm_mass_kg - share - at_plate]
        positions += [0.5 * (elbow[i] + plate(theta, robot))]
    masses += [d.plate_mass_kg + d.payload_mass_kg + 3.0 * at_plate]
    positions += [plate(theta, robot)]
    return np.array(masses), np.array(positions)


def energies(theta, thetadot, robot, rods=False):
    """Kinetic and potential energy [J] of the heap of masses and the three rotors."""
    tiny = 1e-30  # complex step: the velocities are exact to rounding
    masses, positions = point_masses(theta + 1j * tiny * thetadot, robot, rods)
    velocities = positions.imag / tiny
    rotor = robot.motor.rotor_inertia_kg_m2 + robot.motor.brake_inertia_kg_m2
    motor_speed = robot.dynamics.gear_ratio * thetadot
    kinetic = 0.5 * masses @ (velocities**2).sum(axis=1) + 0.5 * rotor * motor_speed @ motor_speed
    return kinetic, robot.dynamics.gravity_m_s2 * masses @ positions[:, 2].real


def momenta(theta, thetadot, robot, rods=False):
    """Generalised momenta dT/dthetadot; T is quadratic in the speeds, so a step of 1 is exact."""
    return np.array(
        [
            0.5
            * (
                energies(theta, thetadot + unit, robot, rods)[0]
                - energies(theta, thetadot - unit, robot, rods)[0]
            )
            for unit in np.eye(3)
        ]
    )


def lagrange(theta, thetadot, thetaddot, robot, rods=False):
    """Torques d/dt dL/dthetadot - dL/dtheta by differences of the energies."""

    def momenta_at(t):
        return momenta(theta + t * thetadot + 0.5 * t * t * thetaddot, thetadot + t * thetaddot, robot, rods)

    def lagrangian(angles):
        kinetic, potential = energies(angles, thetadot, robot, rods)
        return kinetic - potential

    slopes = [derivative(lambda h, unit=unit: lagrangian(theta + h * unit)) for unit in np.eye(3)]
    return derivative(momenta_at) - np.array(slopes)


def test_the_reference_pose_has_its_known_mass_matrix_and_torques(robot):
    assert dynamics.mass_matrix(THETA, robot)[0] == pytest.approx(
        [0.673157120, -0.128593741, -0.169529359], abs=PRINTED
    )
    assert dynamics.gravity(THETA, robot) == pytest.approx(
        [-9.011151622, -7.020203669, -4.423866022], abs=PRINTED
    )
    tau = dynamics.inverse(THETA, THETADOT, THETADDOT, robot)
    assert tau == pytest.approx([-5.171380227, -29.767193149, 20.599684848], abs=PRINTED)


def test_the_reference_state_has_its_known_energies(robot):
    assert energies(THETA, THETADOT, robot) == pytest.approx((2.611050523, -22.473857103), abs=PRINTED)


@pytest.mark.parametrize(
    'change',
    [
        {},
        {'dynamics__payload_mass_kg': 2.0},
        {'dynamics__forearm_share_at_elbow': 0.25, 'dynamics__gravity_m_s2': 0.0},
        {'dynamics__gear_in': 55.0, 'dynamics__gear_out': 2.0, 'motor__rotor_inertia_kg_m2': 3e-4},
        {
            'kinematics__upper_arm_length_m': 0.3,
            'kinematics__forearm_length_m': 0.8,
            'dynamics__elbow_mass_kg': 0.0,
        },
    ],
)
@pytest.mark.parametrize('rods', [False, True])
def test_torques_follow_lagranges_equation_of_the_masses(rods, change, robot):
    changed = robot.replace(**change)
    for theta, thetadot, thetaddot in zip(*states(12), strict=True):
        expected = lagrange(theta, thetadot, thetaddot, changed, rods)
        found = dynamics.inverse(theta, thetadot, thetaddot, changed, rods=rods)
        assert found == pytest.approx(expected, abs=LAGRANGE)


def test_the_mass_matrix_is_symmetric_and_positive_definite(robot):
    theta, _, _ = states(2000)
    mass = dynamics.mass_matrix(theta, robot)
    assert np.array_equal(mass, mass.swapaxes(-1, -2))
    assert (
        np.linalg.eigvalsh(mass).min() > dynamics.inertia(robot)['arm'].min() - 1e-12
    )  # the plate can only add


def test_the_mass_matrix_is_the_torque_of_unit_accelerations(robot):
    theta, thetadot, _ = states(50)
    for i, unit in enumerate(np.eye(3)):
        column = dynamics.inverse(theta, thetadot, unit, robot) - dynamics.inverse(
            theta, thetadot, 0.0 * unit, robot
        )
        assert np.abs(dynamics.mass_matrix(theta, robot)[:, :, i] - column).max() < 1e-12


def test_power_at_the_joints_is_the_rate_of_energy(robot):
    """Equivalent to A' - 2C being skew."""
    for theta, thetadot, thetaddot in zip(*states(25), strict=True):

        def energy_at(t, theta=theta, thetadot=thetadot, thetaddot=thetaddot):
            angles = theta + t * thetadot + 0.5 * t * t * thetaddot
            return sum(energies(angles, thetadot + t * thetaddot, robot))

        power = dynamics.inverse(theta, thetadot, thetaddot, robot) @ thetadot
        assert power == pytest.approx(derivative(energy_at), abs=POWER)


def test_a_dot_minus_2_c_is_skew(robot):
    theta, thetadot, _ = states(200)
    a_dot = derivative(lambda h: dynamics.mass_matrix(theta + h * thetadot, robot))
    centrifugal = dynamics.inverse(theta, thetadot, np.zeros(3), robot) - dynamics.gravity(theta, robot)
    quadratic = np.einsum('ni,nij,nj->n', thetadot, a_dot, thetadot) - 2.0 * (thetadot * centrifugal).sum(
        axis=-1
    )
    assert np.abs(quadratic).max() < POWER


@pytest.mark.parametrize('rods', [False, True])
def test_forward_undoes_inverse(rods, robot):
    theta, thetadot, thetaddot = states(2000)
    tau = dynamics.inverse(theta, thetadot, thetaddot, robot, rods=rods)
    assert np.abs(dynamics.forward(theta, thetadot, tau, robot, rods=rods) - thetaddot).max() < ENGINE * 60.0


def test_at_rest_a_rod_is_two_halves_at_its_ends(robot):
    halves = robot.replace(dynamics__forearm_share_at_elbow=0.5)
    theta, _, _ = states(50)
    at_rest = dynamics.inverse(theta, np.zeros(3), np.zeros(3), robot, rods=True)
    assert at_rest == pytest.approx(dynamics.gravity(theta, halves), abs=1e-12)


def test_three_equal_arms_carry_a_central_plate_alike(robot):
    theta = kinematics.inverse([0.0, 0.0, -0.8], robot.kinematics)
    tau = dynamics.gravity(theta, robot)
    assert tau == pytest.approx([tau[0]] * 3, abs=1e-12)
    assert tau[0] < 0.0  # gravity pulls the arms to positive angles, the motors hold against it
    turned = dynamics.inverse(np.roll(THETA, 1), np.roll(THETADOT, 1), np.roll(THETADDOT, 1), robot)
    assert turned == pytest.approx(np.roll(dynamics.inverse(THETA, THETADOT, THETADDOT, robot), 1), abs=1e-12)


@pytest.mark.parametrize('shape', [(), (4,), (2, 3), (0,)])
def test_arrays_of_states_give_the_bits_of_single_states(shape, robot):
    theta, thetadot, thetaddot = (a.reshape(*shape, 3) for a in states(int(np.prod(shape))))
    functions = (dynamics.inverse, dynamics.forward, dynamics.coupling)
    for function in functions:
        together = function(theta, thetadot, thetaddot, robot)
        assert together.shape == (*shape, 3)
        for index in np.ndindex(shape):
            alone = function(theta[index], thetadot[index], thetaddot[index], robot)
            assert together[index].tobytes() == alone.tobytes()


def test_a_triple_that_closes_no_chain_has_no_torque(robot):
    short = robot.replace(kinematics__forearm_length_m=0.5)
    assert np.isnan(dynamics.gravity(np.zeros(3), short)).all()
    assert np.isnan(dynamics.gravity([np.nan, 0.0, 0.0], robot)).all()


def test_motor_current_friction_linear_inertia_and_coupling_balance(robot):
    """Eq. 4.29 on the motor side: K_m I - friction = (A_bar / k_r^2) w' + d, for any A_bar."""
    theta, thetadot, thetaddot = states(100)
    gear, motor_torque = robot.dynamics.gear_ratio, dynamics.inverse(theta, thetadot, thetaddot, robot) / 32.0
    for inertia in (0.5, robot.drive.observer_arm_inertia_kg_m2):
        changed = robot.replace(drive__observer_arm_inertia_kg_m2=inertia)
        d = dynamics.coupling(theta, thetadot, thetaddot, changed)
        assert np.abs(inertia / gear**2 * (gear * thetaddot) + d - motor_torque).max() < 1e-12


def test_at_rest_the_coupling_is_the_load_and_the_preload_at_home_is_known(robot):
    theta = kinematics.inverse(robot.motion.home_m, robot.kinematics)
    d = dynamics.coupling(theta, np.zeros(3), np.zeros(3), robot)
    assert d == pytest.approx(dynamics.gravity(theta, robot) / 32.0, abs=1e-15)
    assert np.abs(d) / robot.motor.torque_constant_n_m_a == pytest.approx(
        [0.28] * 3, abs=0.005
    )  # parameter study: 0.28 A


def test_feed_forward_and_observer_inertia_are_those_of_the_workspace(robot):
    """The parameter study's figures over the cylinder: mean diagonal 0.6564, eigenvalues 0.309 to 1.576 kg m2."""
    random, k = np.random.default_rng(SEED), robot.kinematics
    radius = 0.5 * k.workspace_diameter_m * np.sqrt(np.append(random.uniform(0.0, 1.0, 4000), np.ones(1000)))
    azimuth, z = (
        random.uniform(-np.pi, np.pi, 5000),
        random.uniform(k.workspace_bottom_m, k.workspace_top_m, 5000),
    )
    points = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z], axis=-1)
    mass = dynamics.mass_matrix(kinematics.inverse(points, k), robot)
    mean = np.einsum('nii->n', mass[:4000]).mean() / 3.0
    eigenvalues = np.linalg.eigvalsh(mass)
    assert mean == pytest.approx(0.6564, rel=0.01)  # a random sample
    assert robot.drive.feedforward_inertia_kg_m2 == pytest.approx(mean / 32.0**2, rel=0.01)
    assert eigenvalues.min() == pytest.approx(0.309, abs=0.005)
    assert eigenvalues.max() == pytest.approx(1.576, rel=0.02)
    middle = 0.5 * (eigenvalues.min() + eigenvalues.max())
    assert robot.drive.observer_arm_inertia_kg_m2 == pytest.approx(middle, rel=0.02)


@pytest.mark.parametrize('rods', [False, True], ids=['split masses', 'rods'])
@pytest.mark.parametrize('payload_kg', [0.0, 0.5, 2.0])
def test_mujoco_finds_the_same_accelerations(payload_kg, rods, robot):
    loaded = robot.replace(dynamics__payload_mass_kg=payload_kg)
    engine = engine_of(loaded, rods=rods)
    worst = 0.0
    for theta, thetadot, push in zip(*states(150), strict=True):
        tau = dynamics.gravity(theta, loaded) + push
        expected, *_ = closed_chain(engine, theta, thetadot, tau, loaded)
        found = dynamics.forward(theta, thetadot, tau, loaded, rods=rods)
        worst = max(worst, float(np.abs(found - expected).max() / max(1.0, np.abs(expected).max())))
        back = dynamics.inverse(theta, thetadot, expected, loaded, rods=rods)
        assert np.abs(back - tau).max() < ENGINE * max(1.0, math.hypot(*tau)) * 10.0
    print(f'largest relative difference to MuJoCo: {worst:.1e}')
    assert worst < ENGINE
