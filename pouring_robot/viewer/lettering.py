"""Words on a picture: title, legend, table, scale, and a label at the tip of each arrow."""

from functools import lru_cache
from pathlib import Path

import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from pouring_robot.viewer.raycast import View
from pouring_robot.viewer.scene import Colour, Scene, at_step, exaggeration_text, legend, length_text
from pouring_robot.viewer.solids import arrow_ends

_INK = (29, 39, 51)
_SOFT_INK = (81, 96, 111)
_LINE = (204, 213, 223)
_WHITE = (255, 255, 255)


def label_arrows(picture: Image.Image, scene: Scene, view: View) -> None:
    """Write its length beside the tip of each arrow that stands alone, rimmed in white to be readable over anything."""
    sheet = ImageDraw.Draw(picture, "RGBA")
    unit = _unit(picture.size)
    for item in scene.arrows:
        tails, tips = arrow_ends(scene, item, scene.first)
        if len(tails) > 1:
            continue
        tail, tip = view.project(np.concatenate([tails, tips]))
        right = max(float(tail[0]), float(tip[0]))
        if np.isfinite(right):
            sheet.text(
                (right + 1.3 * unit, float(tip[1])),
                length_text(at_step(item.vectors_m, scene.first)),
                font=_font(round(1.1 * unit), True),
                fill=_bytes(tuple(0.8 * value for value in item.colour)),
                anchor="lm",
                stroke_width=max(2, unit // 5),
                stroke_fill=_WHITE,
            )


class Panel:
    """The box in the upper left corner: title, legend, table and scale.

    Attributes:
        right: column at which the box ends, pixels.
    """

    def __init__(self, scene: Scene, size: tuple[int, int]) -> None:
        """Measure the words; letters grow with the picture, so that it can be shown at any size."""
        step, self._unit = scene.steps[scene.first], _unit(size)
        self._caption = step.caption
        self._legend, self._scale = legend(scene), exaggeration_text(scene)
        self._title = _font(round(1.1 * self._unit), True)
        self._plain, self._bold = _font(self._unit), _font(self._unit, True)
        self._swatch_width = round(1.9 * self._unit)
        what = max((self._plain.getlength(row[0]) for row in self._caption), default=0.0)
        figure = max((self._plain.getlength(row[1]) for row in self._caption), default=0.0)
        narrow = max(
            0.3 * size[0],
            self._bold.getlength(self._scale),
            what + 1.6 * self._unit + figure,
            *(self._swatch_width + self._plain.getlength(entry.words) for entry in self._legend),
        )
        self._lines = [*_wrapped(scene.title, self._title, narrow), *_wrapped(step.label, self._title, narrow)]
        widest = max((self._title.getlength(one) for one in self._lines), default=0.0)
        self._inner = max(narrow, widest)
        self._pad = round(0.9 * self._unit)
        self.right = round(self._unit + self._inner + 2 * self._pad)

    def write(self, picture: Image.Image) -> None:
        """Draw the box and its words."""
        self._sheet = ImageDraw.Draw(picture, "RGBA")
        unit, pad, line, rule = self._unit, self._pad, round(1.5 * self._unit), round(0.55 * self._unit)
        caption = self._caption
        rows = 1 + len(self._lines) + len(self._legend) + len(caption)
        height = 2 * pad + rows * line + rule * (2 if caption else 1)
        self._sheet.rounded_rectangle((unit, unit, self.right, unit + height), radius=pad // 2, fill=(*_WHITE, 219))
        left, right, y = unit + pad, self.right - pad, unit + pad
        for words in self._lines:
            self._sheet.text((left, y), words, font=self._title, fill=_INK)
            y += line
        y += round(0.3 * unit)
        for entry in self._legend:
            self._swatch(left, y, entry.colour, entry.opacity, entry.is_arrow)
            self._sheet.text((left + self._swatch_width, y), entry.words, font=self._plain, fill=_INK)
            y += line
        if caption:
            y = self._rule(left, right, y, rule)
        for what, figure in caption:
            self._sheet.text((left, y), what, font=self._plain, fill=_SOFT_INK)
            self._sheet.text((right, y), figure, font=self._plain, fill=_INK, anchor="ra")
            y += line
        y = self._rule(left, right, y, rule)
        self._sheet.text((left, y), self._scale, font=self._bold, fill=_INK)

    def _rule(self, left: float, right: float, y: int, height: int) -> int:
        """Draw a thin line across the box and return where the next words begin."""
        middle = y + height // 3
        self._sheet.line((left, middle, right, middle), fill=_LINE, width=max(1, self._unit // 12))
        return y + height

    def _swatch(self, left: int, y: int, colour: Colour, opacity: float, is_arrow: bool) -> None:
        """Draw the sign that stands before the words of a legend line."""
        width, height = round(1.4 * self._unit), round(0.8 * self._unit)
        top = y + round(0.22 * self._unit)
        fill = (*_bytes(colour), round(255 * opacity))
        if not is_arrow:
            self._sheet.rectangle((left, top, left + width, top + height), fill=fill, outline=(*_INK, 150))
            return
        middle, neck = top + height / 2, left + 0.55 * width
        self._sheet.line((left, middle, neck, middle), fill=fill, width=max(2, height // 4))
        self._sheet.polygon([(neck, top), (left + width, middle), (neck, top + height)], fill=fill)


def _wrapped(words: str, font: ImageFont.FreeTypeFont, width: float) -> list[str]:
    """Return the words in lines that are no wider than asked, where the words allow it."""
    lines: list[str] = []
    for word in words.split():
        if lines and font.getlength(f"{lines[-1]} {word}") <= width:
            lines[-1] += f" {word}"
        else:
            lines.append(word)
    return lines


def _unit(size: tuple[int, int]) -> int:
    """Return the size of the letters in pixels for a picture of a width and height."""
    return max(6, round(16 * min(size[0] / 1200, size[1] / 900)))


def _bytes(colour: tuple[float, ...]) -> tuple[int, int, int]:
    red, green, blue = (round(255 * min(max(value, 0.0), 1.0)) for value in colour)
    return red, green, blue


@lru_cache(maxsize=32)
def _font(size: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """Return the typeface that matplotlib brings along: the same on every machine."""
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name), size)
