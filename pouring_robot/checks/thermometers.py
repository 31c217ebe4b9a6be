"""Checks of temperatures: sensors that hung, jumped or came off, columns exchanged or in another unit.

Cold parts have the hall's temperature, and nothing cools them below it. A hall that reads more than
:data:`HOTTEST_HALL_DEGC` may be at 13 °C, given in °F, below which nobody works hard indoors (HSE, Approved Code of
Practice L24, regulation 7), or next to a furnace.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from pouring_robot.campaign import columns
from pouring_robot.campaign.data import Campaign
from pouring_robot.checks.conditions import known, wrong_unit
from pouring_robot.checks.flags import DataFlag, FlagCode, Severity, flagged, stuck, where
from pouring_robot.io.temperatures import ABSOLUTE_ZERO_DEGC, IRON_IN_KELVIN, SURROUNDINGS_DEGC
from pouring_robot.mechanism.arrays import FloatArray, Indices, robust_sigma, runs

HOTTEST_HALL_DEGC, COLDEST_HALL_DEGC = 55.0, -30.0
_SHORTEST_RUN = 10
_SPIKE_K = 25.0
_COLD_K = 10.0  # a part within this of the hall's temperature is cold
_ALIKE_K = 5.0  # cold parts differ by less
_APART_K = 30.0  # no part as cold as the others is this far from the hall
_FEWEST_COLD = 3
_NEARLY_ALL = 0.9
_MOVING_K = 5.0  # a thermometer with a larger range follows something
_APART_TIMES = 3.0  # factor by which the parts' spread grows, in proportion to their warmth
_MISTAKES: tuple[tuple[str, Callable[[FloatArray], FloatArray]], ...] = (
    ("kelvin", lambda values: values + ABSOLUTE_ZERO_DEGC),
    ("degrees Fahrenheit", lambda values: (values - 32.0) / 1.8),
)


def check_thermometers(campaign: Campaign) -> Iterator[DataFlag]:
    """Yield mistakes in the temperatures."""
    if all(campaign.quantity(name) is None for name in (columns.AMBIENT, *campaign.robot.thermometers)):
        yield flagged(campaign, FlagCode.NO_TEMPERATURES, "there is no temperature in the campaign")
    yield from _stuck_temperatures(campaign)
    yield from _jumps(campaign)
    yield from _in_the_air(campaign)
    yield from _still_thermometers(campaign)
    exchanged = list(_exchanged_with_the_hall(campaign))
    yield from exchanged or _units(campaign)


def _stuck_temperatures(campaign: Campaign) -> Iterator[DataFlag]:
    """Find a sensor on the robot that keeps one value while most of the others change."""
    names = [name for name in readings(campaign) if name != columns.AMBIENT]
    changes = {name: np.diff(campaign.conditions[name]) != 0.0 for name in names}
    for name in names:
        others = [changes[other] for other in names if other != name]
        if others:
            for rows in runs(~changes[name] & (np.mean(others, axis=0) > 0.5), _SHORTEST_RUN):
                yield stuck(campaign, name, campaign.conditions[name][rows[0]], rows, Severity.WARNING)


def _jumps(campaign: Campaign) -> Iterator[DataFlag]:
    """Find single readings far from both neighbours: a leg or a hall does not warm and cool within one pose."""
    for name in readings(campaign) if len(campaign) >= 5 else ():
        values = campaign.conditions[name]
        before, now, after = values[:-2], values[1:-1], values[2:]
        deviation = now - 0.5 * (before + after)
        limit = np.fmax(_SPIKE_K, 10.0 * robust_sigma(deviation)) + 2.0 * np.abs(after - before)
        rows = 1 + np.flatnonzero(np.abs(deviation) > limit)
        if rows.size:
            largest, heading = float(np.abs(deviation[rows - 1]).max()), campaign.heading(name)
            message = f"column '{heading}' jumps by up to {largest:.0f} K and back at {where(campaign, rows)}"
            yield flagged(campaign, FlagCode.COLUMN_JUMP, message, rows, [name], {"largest_K": largest})


def _in_the_air(campaign: Campaign) -> Iterator[DataFlag]:
    """Find a sensor on the robot that is suddenly as cold as the hall and stays so: it came off, or was not on yet.

    No part cools like this while most others stay warm: their time constants do not differ as much. Sensors at sources
    of heat are exempt, as a ladle may be lifted off.
    """
    hall, read = campaign.conditions.get(columns.AMBIENT), readings(campaign)
    parts = [name for name in _warmed(campaign) if name in read]
    if hall is None or len(parts) < 3:  # two others must show that parts are warm
        return
    warmth = {name: campaign.conditions[name] - hall for name in parts}
    for name, own in warmth.items():
        others = np.array([warmth[other] for other in parts if other != name])
        for session in campaign.rows_by_session().values():
            rows = session[np.isfinite(own[session])]
            for cold, step in _cold_at_once(own[rows], others[:, rows]):
                message = (
                    f"column '{campaign.heading(name)}' is as cold as the hall in {where(campaign, rows[cold])}, with "
                    f"a step of {step:.0f} K, while the other parts stay warm"
                )
                yield flagged(campaign, FlagCode.COLUMN_JUMP, message, rows[cold], [name], {"largest_K": step})


def _cold_at_once(own: FloatArray, others: FloatArray) -> Iterator[tuple[Indices, float]]:
    """Yield runs of rows that are suddenly cold, and the step, given warmth of a part (n,) and of others (k, n).

    Both are in K above the hall.
    """
    cold, limit = np.abs(own) < _COLD_K, np.fmax(_SPIKE_K, 10.0 * robust_sigma(np.diff(own)))
    for run in runs(cold[:-1] & cold[1:], 2):
        ends = ((run[0], run[0] - 1), (run[-1], run[-1] + 1))
        for inside, outside in (end for end in ends if 0 <= end[1] < own.size):
            kept = others[:, inside] > np.maximum(_COLD_K, _NEARLY_ALL * others[:, outside])
            step = float(own[outside] - own[inside])
            if step > limit and np.mean(kept) > 0.5:
                yield run, step
                break


def _still_thermometers(campaign: Campaign) -> Iterator[DataFlag]:
    """Find a sensor that never changes in the whole campaign while others do, and is not at a source kept hot."""
    names = _parts(campaign)
    spread = {name: float(np.ptp(known(campaign, name))) for name in names}
    # Those that flicker from row to row were certainly read, and finely.
    lively = [n for n in names if spread[n] > _MOVING_K and np.mean(np.diff(known(campaign, n)) != 0.0) > 0.5]
    still = [name for name in names if spread[name] == 0.0 and 2 * known(campaign, name).size > len(campaign)]
    for name in still if len(lively) >= 2 else ():
        value = float(known(campaign, name)[0])
        others = np.concatenate([known(campaign, other) for other in lively])
        if others.min() < value < others.max():
            message = (
                f"column '{campaign.heading(name)}' is {value:g} in every reading, while {len(lively)} other "
                f"temperatures vary by up to {max(spread.values()):.0f} K"
            )
            yield flagged(campaign, FlagCode.STUCK_COLUMN, message, (), [name], {"value": value})


def _exchanged_with_the_hall(campaign: Campaign) -> Iterator[DataFlag]:
    hall = campaign.conditions.get(columns.AMBIENT)
    if hall is None or (hottest := float(np.nanmax(hall))) <= HOTTEST_HALL_DEGC:
        return
    colder = [name for name in _parts(campaign) if _like_a_hall(campaign.conditions[name], hall)]
    # A hall that warms up is ahead of all parts, too.
    warms = len(colder) > 1 and hottest <= SURROUNDINGS_DEGC[1] and {*_warmed(campaign)} <= {*colder}
    if colder and not warms:
        headings = " and ".join(f"'{campaign.heading(column)}'" for column in (columns.AMBIENT, colder[0]))
        message = (
            f"columns {headings} seem to be exchanged: the hall would reach {hottest:.0f} °C, and the part only "
            f"{known(campaign, colder[0]).max():.0f} °C"
        )
        yield flagged(campaign, FlagCode.CONDITIONS_EXCHANGED, message, (), (columns.AMBIENT, colder[0]))


def _like_a_hall(values: FloatArray, hall: FloatArray) -> bool:
    """Return whether a part (n,) is mild, mostly colder than the hall, (n,), and varies less."""
    both = np.isfinite(values) & np.isfinite(hall)
    part, air = values[both], hall[both]
    mild = part.size and COLDEST_HALL_DEGC < part.min() < part.max() < HOTTEST_HALL_DEGC
    return bool(mild and np.mean(part < air - _ALIKE_K) > 0.5 and np.ptp(air) > np.ptp(part))


def _units(campaign: Campaign) -> Iterator[DataFlag]:
    hall, parts = campaign.conditions.get(columns.AMBIENT), _parts(campaign)
    hottest = {name: _hottest(campaign, name) for name in parts}
    flags = [flag for name in parts for flag in _no_temperature(campaign, name, hottest[name], Severity.WARNING)]
    if hall is None:
        yield from flags or _all_in_kelvin(campaign)
        return
    flags += _no_temperature(campaign, columns.AMBIENT, SURROUNDINGS_DEGC[1], Severity.ERROR)
    flags = flags or list(_hall_in_fahrenheit(campaign, hall))
    yield from flags
    if not flags and len(parts) >= 3:  # two others must show which rows are cold
        yield from list(_one_in_another_unit(campaign, hall, parts)) or _begun_in_another_unit(campaign, hall)


def _one_in_another_unit(campaign: Campaign, hall: FloatArray, parts: Sequence[str]) -> Iterator[DataFlag]:
    """Find a part that is as cold as the others only if its figures are in kelvin or °F; ``hall`` is (n,)."""
    for name in parts:
        others = [campaign.conditions[other] - hall for other in parts if other != name]
        cold = np.median(np.abs(others), axis=0) < _COLD_K
        values, apart = campaign.conditions[name][cold], np.array(others)[:, cold]
        for scale, degC in _MISTAKES:
            # Converted, it must be as cold as the others are, not only near the hall: a part may warm up alone.
            warmth = degC(values) - hall[cold]
            least, most = apart.min(axis=0, initial=0.0), apart.max(axis=0, initial=0.0)
            alike = (warmth > least - _ALIKE_K) & (warmth < most + _ALIKE_K)
            alike &= np.abs(values - hall[cold]) > _APART_K
            if alike.size >= _FEWEST_COLD and alike.mean() > _NEARLY_ALL and np.ptp(values) > 0.0:
                said = f"{scale} under a heading in °C: it reads {np.median(values):.0f} where the others are cold"
                yield wrong_unit(campaign, name, said, {"median_degC": float(np.median(values))}, Severity.WARNING)


def _begun_in_another_unit(campaign: Campaign, hall: FloatArray) -> Iterator[DataFlag]:
    """Find three parts or more that begin as warm as the hall (n,) is in kelvin or °F, and diverge from there.

    All others begin cold. In a sound machine that begins so warm, the parts usually differ as much at first as later,
    in proportion to their warmth. In a simulation of machines with parts up to 100 K warm at first and 100 to 250 K
    later, which differ by 10 or 20 %, this test (°F) is met by two machines of a thousand with four parts, and five
    with three: it is a warning.
    """
    parts = _warmed(campaign)
    warmth = {name: campaign.conditions[name] - hall for name in parts}
    begins = {name: _begin(values) for name, values in warmth.items()}
    for scale, degC in _MISTAKES:
        meant = {name: _begin(degC(campaign.conditions[name]) - hall) for name in parts}
        wrong = [name for name in parts if abs(meant[name]) < _ALIKE_K and begins[name] > _APART_K]
        if len(wrong) < 3 or any(abs(begins[name]) > _COLD_K for name in parts if name not in wrong):
            continue
        courses = np.array([warmth[name] for name in wrong])
        courses = courses[:, np.isfinite(courses).all(axis=0)]
        hottest = courses[:, courses.mean(axis=0).argmax()] if courses.size else np.ones(1)
        first = np.array([begins[name] for name in wrong])
        if _APART_TIMES * np.ptp(first) / first.mean() < np.ptp(hottest) / hottest.mean():
            others = f"{scale} under a heading in °C (as may {len(wrong) - 1} other parts)"
            for name in (name for name in wrong if not campaign.heading(name).endswith("_K")):
                began = begins[name] + _begin(hall)
                said = f"{others}: it begins at {began:.0f} °C, which converted is the hall's temperature"
                yield wrong_unit(campaign, name, said, {"begins_degC": began}, Severity.WARNING)


def _begin(values: FloatArray) -> float:
    """Return the first known value of (n,); NaN where there is none."""
    return float(next(iter(values[np.isfinite(values)]), np.nan))


def _all_in_kelvin(campaign: Campaign) -> Iterator[DataFlag]:
    """Find parts with one lowest temperature, which in kelvin is a hall's, where no hall temperature is given."""
    parts = _parts(campaign)
    # Several parts are not equally hot by chance; where none is heated, a single one is not hot either.
    if len(parts) > bool(campaign.robot.expected_thermometers):
        coldest = [float(known(campaign, name).min()) for name in parts]
        low, high = min(coldest), max(coldest)
        halls = low + ABSOLUTE_ZERO_DEGC > COLDEST_HALL_DEGC and high + ABSOLUTE_ZERO_DEGC < HOTTEST_HALL_DEGC
        if halls and high - low < _COLD_K:
            said = f"kelvin under a heading in °C (as may all parts): they are at {low:.0f} °C or more"
            yield wrong_unit(campaign, parts[0], said, {"coldest_degC": low}, Severity.WARNING)


def _hottest(campaign: Campaign, name: str) -> float:
    """Return the highest median temperature a part may have, in °C: nearer to the hottest like it than in kelvin.

    At least two others of its kind must be read; otherwise it is :data:`IRON_IN_KELVIN`.
    """
    kinds = campaign.robot.causes.thermometers if campaign.robot.causes else ()
    others = {other for kind in kinds if name in kind.members for other in kind.members if other != name}
    middles = [float(np.median(known(campaign, other))) for other in _parts(campaign) if other in others]
    return max(middles) - 0.5 * ABSOLUTE_ZERO_DEGC if len(middles) > 1 else IRON_IN_KELVIN


def _no_temperature(campaign: Campaign, name: str, hottest: float, severity: Severity) -> Iterator[DataFlag]:
    """Find a column that is colder than any surroundings, or hotter than it can be, ``hottest``, in °C."""
    middle, coldest = float(np.median(known(campaign, name))), SURROUNDINGS_DEGC[0]
    if coldest <= middle <= hottest:
        return
    in_kelvin = campaign.heading(name).endswith("_K")
    meant = middle + (-ABSOLUTE_ZERO_DEGC if in_kelvin else ABSOLUTE_ZERO_DEGC)
    said = "°C under a heading in K" if in_kelvin else "kelvin under a heading in °C (as may other temperatures)"
    said = f"{said if coldest <= meant <= hottest else 'another unit'}: it would be at {middle:.0f} °C"
    yield wrong_unit(campaign, name, said, {"median_degC": middle}, severity)


def _hall_in_fahrenheit(campaign: Campaign, hall: FloatArray) -> Iterator[DataFlag]:
    """Find a hall (n,) so hot in °C that °F may be meant; an error where parts are colder, as nothing cools them."""
    middle, parts = float(np.nanmedian(hall)), _warmed(campaign)
    if middle <= HOTTEST_HALL_DEGC or campaign.heading(columns.AMBIENT).endswith("_K"):
        return
    colder = sum((campaign.conditions[name] < hall - _APART_K for name in parts), np.zeros(hall.size, dtype=int))
    wrong = np.count_nonzero(2 * colder > len(parts)) >= _FEWEST_COLD
    said = f"the hall would be at {middle:.0f} °C{', and parts are colder' if wrong else ''}"
    said = f"degrees Fahrenheit under a heading in °C (as may other temperatures): {said}"
    remedy = "if so, convert the column; if the hall really is that hot, give it in kelvin, as ambient_K"
    severity = Severity.ERROR if wrong else Severity.WARNING
    yield wrong_unit(campaign, columns.AMBIENT, said, {"median_degC": middle}, severity, remedy)


def readings(campaign: Campaign) -> tuple[str, ...]:
    """Return the temperatures that were read: one that rarely changes was set, or is read coarsely."""
    given = (name for name in (columns.AMBIENT, *campaign.robot.thermometers) if name in campaign.conditions)
    return tuple(name for name in given if 2 * np.sum(np.diff(campaign.conditions[name]) == 0.0) < len(campaign) - 1)


def _parts(campaign: Campaign) -> tuple[str, ...]:
    """Return the thermometers on the robot that were read, whether they changed or not."""
    return tuple(name for name in campaign.robot.thermometers if name in campaign.conditions)


def _warmed(campaign: Campaign) -> tuple[str, ...]:
    """Return the thermometers that were read and are on no source of heat."""
    kinds = campaign.robot.causes.thermometers if campaign.robot.causes else ()
    sources = {name for kind in kinds if kind.hot_degC is not None for name in kind.members}
    return tuple(name for name in _parts(campaign) if name not in sources)
