"""Every fault of a motor is measured back as the number that was put in."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lenscal.errors import InputError, OutOfRangeError
from lenscal.rig.simulated import LensFaults, MotorFaults, SimulatedRig
from lenscal.rig.simulated.motors import LensMotors, Motor
from lenscal.setting import ApproachSide, LensSetting, LensTravel

BELOW, ABOVE = ApproachSide.FROM_BELOW, ApproachSide.FROM_ABOVE
TRAVEL = LensTravel(zoom=(0.0, 1000.0), focus=(0.0, 1000.0), iris=(5.0, 75.0))


class Unasked:
    """A source of randomness that nobody may draw from."""


def moved(motor, target, side=BELOW, rng=None, clock_s=0.0):
    motor.move_to(target, side, rng or Unasked())
    return motor.position(clock_s)


def test_a_motor_without_faults_arrives_exactly_and_draws_nothing():
    motor = Motor(MotorFaults(), 500.0)
    for target, side in [(612.3, BELOW), (100.0, BELOW), (100.0, ABOVE), (333.3, ABOVE)]:
        way = motor.move_to(target, side, Unasked())
        assert motor.position(7200.0) == motor.believed == target
        assert way >= 0
    assert Motor(MotorFaults(), 500.0).move_to(400.0, BELOW, Unasked()) == 100.0


def test_steps_are_whole_and_read_back():
    motor = Motor(MotorFaults(step=2.0), 500.0)
    targets = np.linspace(100, 130, 61)
    reached = np.array([moved(motor, t) for t in targets])
    assert motor.believed == reached[-1]
    assert set(np.diff(reached)) == {0.0, 2.0}
    assert np.abs(reached - targets).max() <= 1.0


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(st.floats(0, 1000), st.sampled_from([BELOW, ABOVE])), min_size=1),
    st.floats(0.1, 50),
)
def test_backlash_is_the_difference_between_the_sides_whatever_went_before(moves, backlash):
    motor = Motor(MotorFaults(backlash=backlash), 500.0)
    for target, side in moves:
        moved(motor, target, side)
    sides = {side: moved(motor, 321.0, side) for side in (BELOW, ABOVE)}
    assert sides[BELOW] == pytest.approx(321.0, abs=1e-9)
    assert sides[ABOVE] - sides[BELOW] == pytest.approx(backlash, abs=1e-9)


def test_hysteresis_is_the_difference_between_the_sides_to_two_percent():
    motor = Motor(MotorFaults(hysteresis=8.0, hysteresis_way=20.0), 500.0)
    sides = [(moved(motor, 321.0, BELOW), moved(motor, 321.0, ABOVE)) for _ in range(5)]
    differences = np.array([above - below for below, above in sides])
    np.testing.assert_allclose(differences, 8.0, rtol=0.04)
    assert np.array(sides)[:, 0].max() - 321.0 < 0.02 * 8.0 + 1e-9


def test_hysteresis_builds_up_on_its_way():
    """Short moves with an overshoot of four times the way: 1 − 1/e per way on the return."""
    motor = Motor(MotorFaults(hysteresis=8.0, hysteresis_way=20.0), 500.0)
    moved(motor, 900.0, BELOW)
    motor._turn(-20.0)
    assert motor.position(0.0) - 880.0 == pytest.approx(8.0 * (1 - np.exp(-1)), rel=1e-3)


def test_repeatability_is_the_scatter_of_moves_to_one_place():
    motor, rng = Motor(MotorFaults(repeatability=1.5), 500.0), np.random.default_rng(1)
    places = [(moved(motor, 100.0, rng=rng), moved(motor, 321.0, rng=rng))[1] for _ in range(800)]
    assert np.std(places) == pytest.approx(1.5, rel=0.08)
    assert np.mean(places) == pytest.approx(321.0, abs=0.2)
    assert motor.position(0.0) == motor.position(0.0) == places[-1]


def test_drift_is_a_speed():
    motor = Motor(MotorFaults(drift_per_hour=-0.7), 500.0)
    hours = np.array([0.0, 1.0, 2.5])
    places = [motor.position(3600.0 * h) for h in hours]
    np.testing.assert_allclose(np.polyfit(hours, places, 1), [-0.7, 500.0])


def test_steps_are_lost_at_the_stated_rate_and_stay_lost():
    motor = Motor(MotorFaults(lost_step_probability=0.2, lost_steps=4.0), 0.0)
    rng = np.random.default_rng(2)
    errors = np.array([moved(motor, 2.0 * i, rng=rng) - 2.0 * i for i in range(1, 1501)])
    assert motor.believed == 3000.0
    lost = np.diff(errors, prepend=0.0)
    # A move of 2 cannot stay behind by more than itself.
    assert set(np.unique(lost.round(9))) == {-2.0, 0.0}
    assert np.mean(lost < 0) == pytest.approx(0.2, rel=0.15)
    far = moved(motor, 100.0, rng=np.random.default_rng(3)) - 100.0
    assert far - errors[-1] in (0.0, 4.0)


def test_long_moves_lose_four_steps_against_the_way():
    motor = Motor(MotorFaults(lost_step_probability=1.0), 500.0)
    rng = np.random.default_rng(0)
    assert moved(motor, 600.0, rng=rng) == 596.0
    assert moved(motor, 500.0, rng=rng) == 500.0
    assert motor.believed == 500.0


def test_a_motor_sent_where_it_stands_does_not_stir():
    motor, rng = (
        Motor(MotorFaults(backlash=3.0, repeatability=1.0), 500.0),
        np.random.default_rng(4),
    )
    here = moved(motor, 400.0, rng=rng)
    assert motor.move_to(400.0, BELOW, rng) == 0.0
    assert motor.position(0.0) == here
    assert motor.move_to(400.0, ABOVE, rng) == pytest.approx(2 * 4.5)


def test_hard_stops_hold_the_glass():
    motors = LensMotors.at(
        LensSetting(0, 1000, 75), TRAVEL, LensFaults(focus=MotorFaults(backlash=5.0))
    )
    motors.move_to(LensSetting(0, 1000), ABOVE, Unasked())
    assert motors.focus.position(0.0) == 1005.0
    assert motors.true_setting(0.0) == LensSetting(0, 1000, 75)


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ({"backlash": -1.0}, "backlash of a motor must be finite and not negative, but is -1.0"),
        ({"repeatability": np.nan}, "repeatability of a motor must be finite"),
        ({"lost_step_probability": 1.5}, "a chance between 0 and 1, but is 1.5"),
        ({"hysteresis": 1.0, "hysteresis_way": 0.0}, "hysteresis needs a hysteresis_way above 0"),
    ],
)
def test_impossible_faults_are_refused(numbers, message):
    with pytest.raises(InputError, match=message):
        MotorFaults(**numbers)


def test_motors_are_homed_to_an_iris_within_the_travel():
    with pytest.raises(InputError, match="must be homed to an iris too"):
        LensMotors.at(LensSetting(0, 0), TRAVEL, LensFaults())
    with pytest.raises(OutOfRangeError, match="zoom 2000 lies outside the travel"):
        LensMotors.at(LensSetting(2000, 0, 75), TRAVEL, LensFaults())


def test_the_rig_knows_where_the_glass_is_and_the_controller_does_not():
    faults = LensFaults(zoom=MotorFaults(backlash=0.4), focus=MotorFaults(backlash=1.0))
    rig = SimulatedRig.preset("vicon-1990", seed=1, faults=faults)
    setting = LensSetting(98, 131, 50)
    assert rig.lens.move_to(setting, BELOW) == rig.lens.setting == setting
    assert rig.true_setting() == setting
    assert rig.lens.move_to(setting, ABOVE) == rig.lens.setting == setting
    glass = rig.true_setting()
    assert glass.zoom == pytest.approx(98.4)
    assert glass.focus == pytest.approx(132.0)
    # The picture is that of the glass: both motors up zooms in.
    assert rig.world.lens_truth().magnification > 1.002 * rig.truth(setting).magnification


def test_the_camera_moves_with_the_glass():
    """0.4 of zoom moves the projection centre by millimetres, which the target shows."""
    faults = LensFaults(zoom=MotorFaults(backlash=0.4))
    rig = SimulatedRig.preset("vicon-1990", seed=1, faults=faults)
    depths = []
    for side in (BELOW, ABOVE):
        rig.lens.move_to(LensSetting(98, 131, 50), side)
        depths.append(rig.true_camera_from_target().translation_mm[2])
    way = (
        rig.truth(LensSetting(98.4, 131)).nodal_offset_mm
        - rig.truth(LensSetting(98, 131)).nodal_offset_mm
    )
    assert depths[1] - depths[0] == pytest.approx(way, rel=1e-3)


def test_overshooting_takes_time():
    clocks = []
    for backlash in (0.0, 10.0):
        rig = SimulatedRig.preset(
            "vicon-1990", faults=LensFaults(focus=MotorFaults(backlash=backlash))
        )
        rig.lens.move_to(LensSetting(72, 50))
        clocks.append(rig.world.clock_s)
    assert clocks[1] - clocks[0] == pytest.approx(6.0 * 2 * 15.0 / 140.0)


def test_settings_with_the_same_seed_are_those_of_a_rig_without_faults():
    """Motors without faults draw no randomness: recordings of before stay what they are."""
    draws = []
    for faults in (LensFaults(), LensFaults(zoom=MotorFaults(backlash=1.0))):
        rig = SimulatedRig.preset("vicon-1990", seed=5, faults=faults)
        rig.lens.move_to(LensSetting(98, 131))
        draws.append(rig.world.rng.random())
    assert draws[0] == draws[1]
