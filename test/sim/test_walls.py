"""The basin: image sources in three dimensions, against rays folded by hand and against pyroomacoustics."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from uw_acoustic_loc.sim.acoustics import images
from uw_acoustic_loc.sim.channel import EmittedPulse, Knots, Paths, Reception
from uw_acoustic_loc.sim.water import Environment, Walls

C = 1480.0
WALLS = Walls(x=-3.0, y=2.0, length=25.0, width=12.0, reflection=(0.9, 0.8, 0.7, 0.6), floor_db=-200.0)
POOL = Environment(
    sound_speed=C, depth=4.0, surface_reflection=-0.95, bottom_reflection=0.5, reflections=1, walls=WALLS
)
SOURCE, RECEIVER = np.array([10.0, 5.0, -3.8]), np.array([2.0, 11.0, -1.2])


def inside(count, rng):
    """(3, count) points of the pool, in map."""
    return WALLS.to_map(rng.uniform([[0.0], [0.0], [-4.0]], [[25.0], [12.0], [0.0]], (3, count)))


def test_first_images_are_mirrored_at_each_boundary():
    positions, gains = images(SOURCE, POOL)
    found = {tuple(p): g for p, g in zip(positions.T.round(9).tolist(), gains.tolist(), strict=True)}
    assert found == {
        (10.0, 5.0, -3.8): 1.0,
        (-16.0, 5.0, -3.8): 0.9,
        (34.0, 5.0, -3.8): 0.8,
        (10.0, -1.0, -3.8): 0.7,
        (10.0, 23.0, -3.8): 0.6,
        (10.0, 5.0, 3.8): -0.95,
        (10.0, 5.0, -4.2): 0.5,
    }
    assert positions[:, 0] == pytest.approx(SOURCE)


@pytest.mark.parametrize("order", [0, 1, 2, 3, 7, 20])
def test_an_order_has_as_many_images_as_the_octahedron_has_points(order):
    """Bounces along the three axes: |i| + |j| + |k| <= n."""
    assert (
        images(SOURCE, replace(POOL, reflections=order))[1].size
        == (2 * order + 1) * (2 * order**2 + 2 * order + 3) // 3
    )


def test_a_turned_basin_turns_its_images():
    turned = replace(POOL, reflections=3, walls=replace(WALLS, yaw=0.7))
    at = WALLS.to_basin(SOURCE[:, None])
    there = turned.walls.to_map(at)[:, 0]
    positions, gains = images(there, turned)
    expected, same = images(SOURCE, replace(POOL, reflections=3))
    assert gains == pytest.approx(same)
    assert turned.walls.to_basin(positions) == pytest.approx(WALLS.to_basin(expected))


def test_what_is_left_out_is_nowhere_loud():
    rng, whole = np.random.default_rng(4), replace(POOL, reflections=20)
    kept = replace(whole, walls=replace(WALLS, floor_db=-70.0))
    (every, gains), (some, _) = images(SOURCE, whole), images(SOURCE, kept)
    heard = {tuple(p) for p in some.T.round(6).tolist()}
    out = np.array([tuple(p) not in heard for p in every.T.round(6).tolist()])
    apart = np.linalg.norm(every[:, out, None] - inside(200, rng)[:, None], axis=0)
    assert 0.5 < out.mean() < 1.0
    assert np.max(np.abs(gains[out, None]) / apart) < 10 ** (-70 / 20)
    apart = np.linalg.norm(every[:, ~out, None] - inside(200, rng)[:, None], axis=0)
    assert np.median(np.max(np.abs(gains[~out, None]) / apart, axis=1)) > 10 ** (-70 / 20)


def test_a_coefficient_of_0_ends_a_path():
    walls = replace(WALLS, reflection=(0.0, 0.0, 0.0, 0.0))
    env = replace(POOL, reflections=4)
    positions, gains = images(SOURCE, replace(env, walls=walls))
    expected, same = images(SOURCE, replace(env, walls=None))
    order = np.argsort(expected[2])
    assert positions[:, np.argsort(positions[2])] == pytest.approx(expected[:, order])
    assert gains[np.argsort(positions[2])] == pytest.approx(same[order])


def click(age):
    """A Gaussian of 20 us on 30 kHz, 0.1 ms after age 0."""
    late = age - 1e-4
    return np.exp(-0.5 * np.square(late / 2e-5)) * np.cos(2 * np.pi * 30e3 * late) * ((age > 0) & (age < 2e-4))


def received(env, size=100_000, rate=1e6):
    """(N,) at a still hydrophone, of a click at time 0."""
    knots = Knots(size, rate)
    positions = np.broadcast_to(RECEIVER[:, None, None], (3, 2, knots.times.size))
    pressure = np.zeros((2, size))
    reception = Reception(knots, np.tile(knots.times, (2, 1)), positions, Paths(*images(SOURCE, env), 0.0))
    reception.add(EmittedPulse(0.0, 2e-4, C, click), pressure)
    assert np.array_equal(*pressure)
    return pressure[0]


def sum_of(positions, gains):
    """(N,) of what `received` must be, path by path."""
    t, expected = np.arange(100_000) / 1e6, np.zeros(100_000)
    for r, gain in zip(np.linalg.norm(positions - RECEIVER[:, None], axis=0), gains, strict=True):
        heard = slice(math.floor(r / C * 1e6), math.floor(r / C * 1e6) + 210)
        expected[heard] += gain / r * click(t[heard] - r / C)
    return expected


def test_every_path_of_a_basin_is_heard_when_and_as_loud_as_it_must():
    env = replace(POOL, reflections=5)
    assert received(env) == pytest.approx(sum_of(*images(SOURCE, env)), abs=1e-9)


HARD = replace(POOL, surface_reflection=0.95)  # pyroomacoustics takes energies that are absorbed, so all are positive


@pytest.fixture(scope="module")
def peers():
    """(3, P) images in map, (P,) coefficients and (P,) orders of pyroomacoustics, whose floor is at z = 0."""
    pra = pytest.importorskip("pyroomacoustics", reason="pyroomacoustics is missing; `make benchmark` installs it")
    names = ("west", "east", "south", "north", "floor", "ceiling")
    values = (*WALLS.reflection, HARD.bottom_reflection, HARD.surface_reflection)
    materials = {name: pra.Material(1.0 - r**2) for name, r in zip(names, values, strict=True)}
    room = pra.ShoeBox([25.0, 12.0, 4.0], fs=1_000_000, materials=materials, max_order=20)
    corner = np.array([WALLS.x, WALLS.y, -4.0])
    room.add_source(SOURCE - corner)
    room.add_microphone(RECEIVER - corner)
    room.image_source_model()
    source = room.sources[0]
    return source.images + corner[:, None], source.damping[0], source.orders


@pytest.mark.parametrize("order", [1, 5, 20])
def test_arrivals_agree_with_pyroomacoustics_in_delay_and_amplitude(peers, order):
    their, damping, orders = peers
    their, damping = their[:, orders <= order], damping[orders <= order]
    our, gains = images(SOURCE, replace(HARD, reflections=order))
    apart, same = cKDTree(their.T).query(our.T)
    assert sorted(same) == list(range(damping.size))  # each of theirs is one of ours
    assert apart.max() < 1e-3
    far, theirs = (np.linalg.norm(p - RECEIVER[:, None], axis=0) for p in (our, their[:, same]))
    assert far / C == pytest.approx(theirs / C, abs=1e-6)
    assert gains / far == pytest.approx(damping[same] / theirs, rel=0.01)


def test_sound_agrees_with_pyroomacoustics(peers):
    """Of its images, but not by its fractional delays, whose filters ring."""
    their, damping, _ = peers
    expected = sum_of(their, damping)
    assert received(replace(HARD, reflections=20)) == pytest.approx(expected, abs=1e-3 * expected.max())
