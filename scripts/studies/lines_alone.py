"""How well the Hangprinter's rows predict each other by plain least squares, without the package's own models.

    python -m scripts.studies.lines_alone

In every row the platform's position is where four lines disagree least. Anchors (the six coordinates that the robot
file leaves free), then a lead of each line, then a build-up of each are fitted to some rows, and tested on the others.
Prints a Markdown table: root mean squares in mm of a row's disagreement (the root of the sum of squares over its four
lines) and of a single line's, half of it.
"""

from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import least_squares

FloatArray = NDArray[np.float64]
SAMPLES = Path(__file__).parents[2] / "examples/machines/hangprinter/samples.csv"
_AT_ORIGIN = np.array([1.597, 1.795, 1.5825, 2.355])  # lengths measured by hand, in m
_A_TURN = 2.0 * np.pi * 0.075 * 20.0 / 255.0 / np.array([2.0, 2.0, 2.0, 4.0])  # m of line a turn of the motor
_BELOW, _NEWTON = -0.1, 12
MODELS = {"as drawn": 0, "anchors": 6, "and leads": 10, "and build-up": 14}
"""How many parameters each has."""


def drawn_anchors() -> FloatArray:
    """Return where one would put anchors up by eye, (4, 3), in m: A, B, C a third of a turn apart, D above."""
    out = np.sqrt(_AT_ORIGIN[:3] ** 2 - _BELOW**2)
    turn = np.radians([-90.0, 30.0, 150.0])
    low = np.column_stack([out * np.cos(turn), out * np.sin(turn), np.full(3, _BELOW)])
    return np.vstack([low, [0.0, 0.0, _AT_ORIGIN[3]]])


def strokes() -> FloatArray:
    """Return what the drawing takes the lines to have paid out in each row, (n, 4), in m."""
    degrees = pd.read_csv(SAMPLES)[[f"line_{line}_deg" for line in "abcd"]].to_numpy()
    return np.asarray(degrees / 360.0 * _A_TURN)


def disagreement(stroke: FloatArray, values: FloatArray) -> FloatArray:
    """Return what is left of each line at the place where they disagree least, (n, 4), in m.

    Args:
        stroke: of some rows, (n, 4).
        values: anchors in m; lead of each line in percent; build-up in percent a metre; as many as there are, (p,).
    """
    full = np.zeros(14)
    full[: len(values)] = values
    anchors, lead, build_up = drawn_anchors(), 0.01 * full[6:10], 0.01 * full[10:]
    anchors[1, 1:], anchors[2], anchors[3, 2] = (
        anchors[1, 1:] + full[:2],
        anchors[2] + full[2:5],
        anchors[3, 2] + full[5],
    )
    length = _AT_ORIGIN + stroke * (1.0 + lead + build_up * stroke)
    place = np.tile([0.0, 0.0, 0.2], (len(stroke), 1))
    for _ in range(_NEWTON):
        across = place[:, None] - anchors
        reach = np.linalg.norm(across, axis=2)
        place = place + (np.linalg.pinv(across / reach[:, :, None]) @ (length - reach)[:, :, None])[:, :, 0]
    return np.asarray(length - np.linalg.norm(place[:, None] - anchors, axis=2))


def fitted(stroke: FloatArray, count: int) -> FloatArray:
    """Return the first so many parameters by least squares to some rows, (count,)."""
    if not count:
        return np.zeros(0)
    sizes = np.repeat([0.1, 1.0], [6, 8])[:count]
    found: FloatArray = least_squares(lambda p: disagreement(stroke, p).ravel(), np.zeros(count), x_scale=sizes).x
    return found


def splits(count: int) -> dict[str, NDArray[np.bool_]]:
    """Return which rows are held out, (n,), by name."""
    place = np.arange(count)
    ends = {
        "last third": place >= 2 * count // 3,
        "last fifth": place >= 4 * count // 5,
        "last half": place >= count // 2,
    }
    return {**ends, "every third": place % 3 == 2, "every fifth": place % 5 == 4}


def size_mm(left: FloatArray) -> float:
    """Return the root mean square of a row's disagreement, in mm."""
    return float(1e3 * np.sqrt((left**2).sum(axis=1).mean()))


def main() -> None:
    """Print the table."""
    stroke = strokes()
    print("| held out | model | fitted: a row | a line | held out: a row | a line |\n|---|---|---|---|---|---|")
    for name, out in splits(len(stroke)).items():
        for model, count in MODELS.items():
            values = fitted(stroke[~out], count)
            sizes = [size_mm(disagreement(stroke[rows], values)) for rows in (~out, out)]
            cells = " | ".join(f"{size:.2f} | {0.5 * size:.2f}" for size in sizes)
            print(f"| {name} | {model} | {cells} |")


if __name__ == "__main__":
    main()
