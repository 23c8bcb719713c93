import math
from dataclasses import replace

import numpy as np
import pytest

from uw_acoustic_loc.sim.acoustics import absorption
from uw_acoustic_loc.sim.channel import EmittedPulse, Knots, Paths, Reception
from uw_acoustic_loc.sim.environment import SoundSpeed
from uw_acoustic_loc.sim.hydrophones import HydrophoneSource
from uw_acoustic_loc.sim.scenario import Environment, Hydrophones, Pinger, Scenario, Vehicle, Waypoint
from uw_acoustic_loc.sim.trajectory import Trajectory

SPEED, RADIUS, SPACING = 5.0, 8.0, 0.6
PINGER = Pinger(id="a", x=45.0, y=12.0, z=-9.0, band_low=18e3, band_high=24e3, offset=0.085)
LEG = 60.0072  # m: the turn begins between two knots, while a ping is heard
CORNER = (LEG - RADIUS) / SPEED  # s, where the straight leg becomes an arc
JUMP = SPACING / 2 * SPEED / RADIUS  # m/s, of a hydrophone's velocity there
SCENARIO = Scenario(
    environment=Environment(depth=25.0, reflections=2),
    vehicle=Vehicle(waypoints=(Waypoint(0, 0), Waypoint(LEG, 0), Waypoint(LEG, 50)), speed=SPEED, turn_radius=RADIUS),
    hydrophones=Hydrophones(spacing=SPACING, format="float32", full_scale=1e6, noise_std=0.0, array_yaw=0.3),
    pingers=(PINGER,),
    duration=20.0,
)


def brute_force(k, error):
    """Frame k of each channel, and the pressure by which an error of the emission time, in s, changes it at most.

    The light-time equation is solved sample by sample with a bisection, in double precision.
    """
    env, t = SCENARIO.environment, k * 0.1 + np.arange(10_000) / 1e5
    motion = Trajectory(SCENARIO.vehicle).at(t)
    s, b, d = env.surface_reflection, env.bottom_reflection, env.depth
    z = PINGER.z
    heights = {z: 1.0, -z: s, -2 * d - z: b, -2 * d + z: s * b, 2 * d + z: b * s}
    sound_speed = SoundSpeed(SCENARIO)
    frames, slack = np.zeros((2, 10_000)), 0.0
    for channel, side in enumerate((-0.5, 0.5)):
        heading = motion.yaw + 0.3
        x = motion.positions + side * SPACING * np.stack([np.cos(heading), np.sin(heading), 0 * heading])
        for height, gain in heights.items():
            r = np.linalg.norm(x - np.array([[PINGER.x], [PINGER.y], [height]]), axis=0)
            for n in range(k - 3, k + 2):
                emission = PINGER.offset + n * PINGER.period
                age = bisected(t, r, float(sound_speed.at(emission))) - emission
                heard = (age > 0) & (age < PINGER.pulse_length)
                level = 100.0 * gain / r[heard] * 10 ** (-absorption(21e3, env) * r[heard] / 20)
                frames[channel, heard] += level * chirp(age[heard])
                slack = max(slack, abs(level).max(initial=0.0) * 2 * math.pi * PINGER.band_high * error)
    return frames, 3 * slack  # up to three paths at a time


def bisected(t, r, c):
    low, high = t - 0.2, t.copy()
    for _ in range(50):
        middle = 0.5 * (low + high)
        late = c * (t - middle) < r
        low, high = np.where(late, low, middle), np.where(late, middle, high)
    return low


def chirp(age):
    edge = np.minimum(1.0, np.minimum(age, 0.01 - age) / 0.001)
    return np.sin(2 * np.pi * (18e3 * age + 0.5 * 6e3 / 0.01 * age**2)) * np.sin(0.5 * np.pi * edge) ** 2


@pytest.mark.parametrize(
    ("k", "bound"),
    [(40, 1e-9), (95, 1e-9), (110, 1e-9), (math.floor(CORNER * 10), 1e-9 + 1e-4 / 4 * JUMP / 1500.0)],
)
def test_the_waveform_is_the_pulse_at_the_exact_emission_time(k, bound):
    """On the straight leg, close by, in the turn, and at its start, where the hydrophones' velocity jumps."""
    frame = HydrophoneSource(SCENARIO).frame(k)
    expected, slack = brute_force(k, bound)
    tolerance = slack + 1e-5  # of float32 samples
    assert np.abs(expected).max() > 1.0
    assert slack < 0.01 * np.abs(expected).max()
    assert frame.h0 == pytest.approx(expected[0], abs=tolerance)
    assert frame.h1 == pytest.approx(expected[1], abs=tolerance)


def still(distance, size=10_000, gains=(1.0,), loss=0.0):
    """A reception 1 MHz wide of sources on the x axis by two hydrophones at the origin."""
    knots = Knots(size, 1e6)
    positions = np.zeros((3, 2, knots.times.size))
    sources = np.array([[distance] * len(gains), [0.0] * len(gains), [0.0] * len(gains)])
    return Reception(knots, np.tile(knots.times, (2, 1)), positions, Paths(sources, np.array(gains), loss))


def constant(age):
    return np.where((age >= 0) & (age <= 1e-3), 1.0, 0.0)


@pytest.mark.parametrize(("distance", "level"), [(7.5, 1 / 7.5), (3.0, 1 / 3.0), (0.5, 1.0)])
def test_a_ping_arrives_when_and_as_loud_as_it_must(distance, level):
    pressure = np.zeros((2, 10_000))
    still(distance).add(EmittedPulse(1e-3, 1e-3, 1500.0, constant), pressure)
    heard = np.flatnonzero(pressure[0]) / 1e6
    assert heard[0] == pytest.approx(1e-3 + distance / 1500.0, abs=1.01e-6)
    assert heard[-1] == pytest.approx(2e-3 + distance / 1500.0, abs=1.01e-6)
    assert pressure[0].max() == pytest.approx(level)  # within 1 m it is no louder than at 1 m
    assert np.array_equal(pressure[0], pressure[1])


def test_paths_add_up_with_their_coefficients_and_absorption():
    pressure = np.zeros((2, 10_000))
    still(2.0, gains=(1.0, -0.7), loss=3.0).add(EmittedPulse(0.0, 1e-3, 1500.0, constant), pressure)
    assert pressure.max() == pytest.approx(0.3 / 2.0 * 10 ** (-6.0 / 20))


@pytest.mark.parametrize("emission", [-2e-3, 9.5e-3, -50e-3, 50e-3])
def test_a_frame_holds_its_part_of_a_ping_and_no_more(emission):
    pressure = np.zeros((2, 10_003))
    still(1.5, size=10_003).add(EmittedPulse(emission, 1e-3, 1500.0, constant), pressure)
    t = np.arange(10_003) / 1e6
    inside = (t > emission + 2e-6 + 1e-3) & (t < emission + 2e-3 - 2e-6)
    outside = (t < emission + 1e-3 - 2e-6) | (t > emission + 2e-3 + 2e-6)
    assert np.all(pressure[:, inside] > 0.6)
    assert not pressure[:, outside].any()


@pytest.mark.parametrize("sign", [1, -1])
def test_an_approaching_receiver_hears_a_higher_tone(sign):
    """The frequency from the zero crossings, against f (1 + v / c) of a still source."""
    speed, tone = 10.0, replace(PINGER, x=1000.0, y=0.0, z=-15.0, pulse="tone", pulse_length=0.05, period=1.0)
    if sign < 0:
        tone = replace(tone, x=-1000.0)
    vehicle = Vehicle(waypoints=(Waypoint(0, 0), Waypoint(500, 0)), speed=speed)
    env = Environment(reflections=0, sound_speed_walk=0.0)
    scenario = replace(SCENARIO, environment=env, vehicle=vehicle, pingers=(tone,))
    samples = np.concatenate([HydrophoneSource(scenario).frame(k).h0 for k in (6, 7)])
    heard = np.flatnonzero(np.abs(samples) > 0.05)
    middle = slice(heard[0] + 700, heard[-1] - 700)
    t, x = np.arange(samples.size)[middle] / 1e5, samples[middle]
    up = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
    crossings = t[up] - x[up] / (x[up + 1] - x[up]) / 1e5
    frequency = (up.size - 1) / (crossings[-1] - crossings[0])
    assert frequency / 21e3 - 1 == pytest.approx(sign * speed / 1500.0, rel=0.01)
