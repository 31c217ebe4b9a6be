"""View factors to a disc against published closed forms, dense quadrature and Monte Carlo."""

import numpy as np
import pytest
from scipy.integrate import quad

from pouring_robot.thermal.network.view_factors import DiscChords, hidden_view_factors

RADIUS = 0.3
DOWN = np.array([0.0, 0.0, -1.0])
NO_BOXES = np.zeros((0, 2, 3))


def element_to_disc(points, normals, boxes=NO_BOXES, chords=24):
    """View factors (...) of elements at points (..., 3)."""
    points, normals = np.broadcast_arrays(points, normals)
    facets, facing = points.reshape(-1, 1, 3), normals.reshape(-1, 1, 3)
    found = hidden_view_factors(facets, facets[:, 0], facing, DiscChords.of(RADIUS, chords), boxes)
    return found.reshape(points.shape[:-1])


def howell_parallel(offset, height):
    """Planar element parallel to a disc, any offset (Howell B-13)."""
    h, r = height / offset, RADIUS / offset
    z = 1.0 + h**2 + r**2
    return 0.5 * (1.0 - (1.0 + h**2 - r**2) / np.sqrt(z**2 - 4.0 * r**2))


def howell_perpendicular(offset, height):
    """Planar element whose plane is at right angles to the disc's and passes beside it (Howell B-14)."""
    h, r = height / offset, RADIUS / offset
    z = 1.0 + h**2 + r**2
    return 0.5 * h * (z / np.sqrt(z**2 - 4.0 * r**2) - 1.0)


def by_quadrature(point, normal, rings=400, spokes=800):
    radius = RADIUS * np.sqrt((np.arange(rings) + 0.5) / rings)
    angle = 2 * np.pi * (np.arange(spokes) + 0.5) / spokes
    r, a = np.meshgrid(radius, angle)
    ray = np.stack([r * np.cos(a), r * np.sin(a), 0 * r], axis=-1) - point
    square = (ray**2).sum(axis=-1)
    return (np.maximum(ray @ normal, 0) * point[2] / square**2).mean() * RADIUS**2


def by_monte_carlo(point, normal, count, seed, boxes=NO_BOXES):
    """Shoot cosine-distributed rays from the element and count those that meet the disc unhindered."""
    random = np.random.default_rng(seed)
    u, v = random.random((2, count))
    helper = np.eye(3)[np.argmin(np.abs(normal))]
    first = np.cross(normal, helper)
    first /= np.linalg.norm(first)
    second = np.cross(normal, first)
    ray = np.sqrt(u)[:, None] * (np.cos(2 * np.pi * v)[:, None] * first + np.sin(2 * np.pi * v)[:, None] * second)
    ray = ray + np.sqrt(1 - u)[:, None] * normal
    falling = ray[:, 2] < 0
    ray = ray[falling]
    hit = point + ray * (point[2] / -ray[:, 2])[:, None]
    on_disc = np.hypot(hit[:, 0], hit[:, 1]) < RADIUS
    hits = hit[on_disc]
    if len(boxes) and len(hits):
        low, high = np.full(len(hits), 0.0), np.full(len(hits), 1.0)
        free = np.ones(len(hits), dtype=bool)
        for a, b in boxes:
            t = np.sort(np.stack([(a - point) / (hits - point), (b - point) / (hits - point)]), axis=0)
            low, high = t[0].max(axis=1), t[1].min(axis=1)
            free &= ~((low < high) & (high > 0) & (low < 1))
        hits = hits[free]
    return len(hits) / count


@pytest.mark.parametrize("height", [0.01, 0.1, 0.3, 1.0, 5.0])
def test_element_on_the_axis(height):
    assert element_to_disc(np.array([0, 0, height]), DOWN) == pytest.approx(
        RADIUS**2 / (RADIUS**2 + height**2), rel=1e-12
    )


@pytest.mark.parametrize("height", [0.02, 0.2, 0.9])
@pytest.mark.parametrize("offset", [1e-3, 0.1, 0.2999, 0.31, 0.6, 2.0])
def test_parallel_element_at_any_offset(offset, height):
    found = element_to_disc(np.array([0.6 * offset, -0.8 * offset, height]), DOWN)
    assert found == pytest.approx(howell_parallel(offset, height), rel=1e-8)


@pytest.mark.parametrize("height", [0.02, 0.2, 0.9])
@pytest.mark.parametrize("offset", [0.3001, 0.31, 0.6, 2.0])
def test_perpendicular_element_beside_the_disc(offset, height):
    found = element_to_disc(np.array([0.0, offset, height]), np.array([0.0, -1.0, 0.0]))
    assert found == pytest.approx(howell_perpendicular(offset, height), rel=1e-8)


def test_any_place_and_tilt_against_quadrature():
    random = np.random.default_rng(4)
    for _ in range(80):
        point = random.uniform([-0.6, -0.6, 0.05], [0.6, 0.6, 0.8])
        normal = random.normal(size=3)
        normal /= np.linalg.norm(normal)
        assert element_to_disc(point, normal) == pytest.approx(by_quadrature(point, normal), abs=3e-6)


def test_any_place_and_tilt_against_monte_carlo():
    for seed, (point, direction) in enumerate(
        [
            ((0.4, 0.1, 0.2), (-1.0, 0.2, -0.3)),
            ((0.1, 0.0, 0.1), (1.0, 0.0, -0.2)),
            ((0.0, 0.5, 0.6), (0.0, -0.6, -0.8)),
        ]
    ):
        normal = np.array(direction) / np.linalg.norm(direction)
        found = element_to_disc(np.array(point), normal)
        assert found == pytest.approx(by_monte_carlo(np.array(point), normal, 2_000_000, seed), abs=1e-3)


def test_coaxial_parallel_discs():
    """The published factor between two coaxial discs (Howell C-41) from elements over the smaller one."""
    small, height = 0.2, 0.25
    mean, _ = quad(lambda r: float(element_to_disc(np.array([r, 0.0, height]), DOWN)) * 2 * r / small**2, 0, small)
    r1, r2 = small / height, RADIUS / height
    x = 1 + (1 + r2**2) / r1**2
    assert mean == pytest.approx(0.5 * (x - np.sqrt(x**2 - 4 * (r2 / r1) ** 2)), rel=1e-9)


def test_nothing_behind_the_disc_or_turned_away():
    assert element_to_disc(np.array([0.5, 0.0, -0.1]), np.array([-1.0, 0.0, 0.0])) == 0.0
    assert element_to_disc(np.array([0.1, 0.0, 0.2]), -DOWN) == 0.0
    assert element_to_disc(np.array([0.5, 0.0, 0.2]), np.array([1.0, 0.0, 0.0])) == 0.0
    assert element_to_disc(np.array([0.0, 0.0, 0.0]), -DOWN) == 0.0


def test_around_a_point_the_factors_make_up_the_solid_angle():
    """The mean over all directions is a quarter of the disc's share of the sphere, times cosine one: Ω/4π."""
    point = np.array([0.2, 0.1, 0.3])
    nodes, weights = np.polynomial.legendre.leggauss(60)
    angles = 2 * np.pi * np.arange(120) / 120
    sine = np.sqrt(1 - nodes**2)
    normals = np.stack(
        [sine[:, None] * np.cos(angles), sine[:, None] * np.sin(angles), np.repeat(nodes[:, None], 120, 1)], axis=-1
    )
    mean = (element_to_disc(point, normals).mean(axis=1) * weights).sum() / 2
    r, a = np.meshgrid(RADIUS * np.sqrt((np.arange(400) + 0.5) / 400), 2 * np.pi * np.arange(400) / 400)
    ray = np.stack([r * np.cos(a), r * np.sin(a), 0 * r], axis=-1) - point
    solid_angle = (point[2] / np.linalg.norm(ray, axis=-1) ** 3).mean() * np.pi * RADIUS**2
    assert mean == pytest.approx(solid_angle / (4 * np.pi), rel=1e-4)


BAR = np.array([[[-0.25, -0.5, 0.04], [-0.15, 0.5, 0.09]]])


def test_a_bar_hides_its_shadow():
    point = np.array([-0.2, 0.0, 0.4])
    # From above the middle of the bar its top edge throws the shadow: half width 0.05 at 0.31 below, 0.4 to the disc.
    half = 0.05 * 0.4 / 0.31

    def seen(x):
        """What of a strip across the disc reaches the element: the integral of h²/(π r⁴) along it."""
        end, square = np.sqrt(max(RADIUS**2 - x**2, 0.0)), (x + 0.2) ** 2 + 0.16
        return 0.16 / np.pi * (end / (end**2 + square) + np.arctan(end / np.sqrt(square)) / np.sqrt(square)) / square

    whole = quad(seen, -RADIUS, RADIUS)[0]
    dark = quad(seen, max(-0.2 - half, -RADIUS), -0.2 + half)[0]
    assert whole == pytest.approx(float(element_to_disc(point, DOWN)), rel=1e-7)
    assert element_to_disc(point, DOWN, BAR, 400) / whole == pytest.approx(1.0 - dark / whole, abs=1e-5)


def test_a_shadow_moves_without_jumps():
    """Steps of 5 µm past the bar: what is hidden changes by less than a thousandth of what 10 mm change."""
    points = np.array([-0.2, 0.1, 0.3]) + np.linspace(0.0, 0.01, 2001)[:, None] * [1.0, 0.3, 0.0]
    share = element_to_disc(points, DOWN, BAR) / element_to_disc(points, DOWN)
    assert np.abs(np.diff(share)).max() < 2e-3 * np.ptp(share) and np.ptp(share) > 0.01


@pytest.mark.parametrize("point", [(-0.2, 0.3, 0.2), (0.3, 0.1, 0.4), (-0.4, -0.3, 0.5)])
def test_hidden_factors_against_monte_carlo(point):
    point = np.array(point)
    normal = -point / np.linalg.norm(point)
    found = element_to_disc(point, normal, BAR, 100)
    free = float(element_to_disc(point, normal))
    counted = by_monte_carlo(point, normal, 2_000_000, 5, BAR)
    assert counted < 0.97 * free
    assert found == pytest.approx(counted, abs=1e-3)


def test_the_default_chords_are_good_to_a_thousandth_of_the_unhidden_factor():
    random = np.random.default_rng(2)
    points = random.uniform([-0.5, -0.5, 0.15], [0.5, 0.5, 0.8], size=(40, 3))
    normals = -points / np.linalg.norm(points, axis=1, keepdims=True)
    coarse, fine = element_to_disc(points, normals, BAR), element_to_disc(points, normals, BAR, 2000)
    free = element_to_disc(points, normals)
    assert np.abs(coarse - fine).max() < 1e-3 * free.max()
    assert (np.abs(coarse - fine) / free).mean() < 1e-3
