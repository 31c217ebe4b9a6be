"""A scene as a picture file, made on any machine: no screen, no graphics card, no system library."""

import io
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from pathlib import Path

import matplotlib
import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from pouring_robot.exceptions import BadInputError
from pouring_robot.io.files import write_whole
from pouring_robot.mechanism.arrays import BoolArray
from pouring_robot.viewer.raycast import Floats, Hits, Layer, View, edge_mask, lit_colours
from pouring_robot.viewer.scene import SKY_BOTTOM, SKY_TOP, LegendEntry, Scene, at_step, exaggeration_text, legend
from pouring_robot.viewer.shapes import Solid, arrow_ends, camera_on, solids, view_height

Pixels = npt.NDArray[np.uint8]

PICTURE_SIZE = (1200, 900)
"""Default width and height, pixels."""
_SMALLEST, _LARGEST = 160, 6000
_SAMPLES = 2  # rays along each side of a pixel
_BAND = 96  # rows of pixels drawn at once
_MARGIN = 12  # rows of samples drawn beyond a band; even, and wider than a blur reaches
_THREADS = 4
_TOUCHING_M = 1e-4
"""A translucent surface closer than this in front of a solid one is not drawn: it would appear as specks."""
_INK = (29, 39, 51)
_SOFT_INK = (81, 96, 111)
_LINE = (204, 213, 223)
_WHITE = (255, 255, 255)


def write_png(scene: Scene, path: Path | str, size: tuple[int, int] = PICTURE_SIZE) -> Path:
    """Write a scene as a PNG picture of a width and height in pixels, whole or not at all; return the path.

    Raises:
        BadInputError: the size is out of range.
        OutputError: the file cannot be written.
    """
    return write_whole(path, png(scene, size))


def png(scene: Scene, size: tuple[int, int] = PICTURE_SIZE) -> bytes:
    """Return the content of such a file; raises BadInputError where the size is out of range."""
    buffer = io.BytesIO()
    draw(scene, size).save(buffer, format="PNG")
    return buffer.getvalue()


def draw(scene: Scene, size: tuple[int, int] = PICTURE_SIZE) -> Image.Image:
    """Return the picture of a scene, of a width and height in pixels, title, legend and table included.

    Solid bodies are shaded; of each translucent robot the surface nearest to the eye is laid over them; arrows come
    last.

    Raises:
        BadInputError: the size is out of range.
    """
    width, height = size
    if not all(_SMALLEST <= side <= _LARGEST for side in size):
        raise BadInputError(f"picture size {width} × {height}: each side must be {_SMALLEST} to {_LARGEST} pixels")
    panel_end, write_panel = _panel(scene, size)
    camera = scene.camera or camera_on(scene)
    # The panel hides the left of the picture; the camera's target is in the middle of the rest.
    middle = 0.5 * width + min(0.5 * panel_end, 0.17 * width)
    view = View(camera, width * _SAMPLES, height * _SAMPLES, middle * _SAMPLES)
    layers = _layers(scene, view)
    with ThreadPoolExecutor(min(_THREADS, os.cpu_count() or 1)) as pool:
        bands = list(pool.map(lambda row: _band(view, layers, row), range(0, height, _BAND)))
    picture = Image.fromarray(np.concatenate(bands), mode="RGB")
    write_panel(picture)
    _label_arrows(picture, scene, View(camera, width, height, middle))
    return picture


def _layers(scene: Scene, view: View) -> list[Layer]:
    """Return the solids of a scene in the order in which they are overlaid: opaque, each translucent robot, arrows."""
    found: dict[tuple[int, str], list[Solid]] = {}
    for body in solids(scene):
        ghost = body.opacity < 1.0 and not body.on_top
        found.setdefault((2 if body.on_top else int(ghost), body.group if ghost else ""), []).append(body)
    return [Layer(found[key], view) for key in sorted(found, key=lambda key: key[0])]


def _band(view: View, layers: Sequence[Layer], first_pixel_row: int) -> Pixels:
    """Return some rows of the picture, shape (rows, columns, 3), 0 to 255.

    Bands fit into the processor's cache and can be drawn at the same time. Each is drawn with a margin,
    in which edges and soft shadows find their neighbours, and then trimmed.
    """
    first = first_pixel_row * _SAMPLES
    last = min(first + _BAND * _SAMPLES, view.rows)
    top, bottom = max(first - _MARGIN, 0), min(last + _MARGIN, view.rows)
    samples = _composite(view, layers, top, bottom)[first - top : last - top]
    rows, columns = (last - first) // _SAMPLES, view.columns // _SAMPLES
    pixels = samples.reshape(rows, _SAMPLES, columns, _SAMPLES, 3).mean(axis=(1, 3))
    return np.asarray(np.round(255 * np.clip(pixels, 0, 1)), dtype=np.uint8)


def _composite(view: View, layers: Sequence[Layer], top: int, bottom: int) -> Floats:
    """Lay background, solid bodies, translucent bodies and arrows over each other."""
    directions, rows = view.directions(top, bottom), bottom - top
    samples = _background(view, top, rows)
    nearest = np.full((rows, view.columns), np.inf, dtype=np.float32)
    for layer in layers:
        down, across = layer.window  # in the picture; in the band it is:
        first = min(max(down.start - top, 0), rows)
        part = slice(first, min(max(down.stop - top, first), rows)), across
        if layer.bodies[0].on_top:
            hits = layer.meet(directions[part])
            _over(samples[part], lit_colours(layer.camera, directions[part], hits), hits.mask, 1.0)
            _over(samples[part], 0.4 * hits.colour, edge_mask(hits), 0.6)
        elif layer.bodies[0].opacity < 1.0:
            _lay_ghost(samples[part], layer, directions[part], nearest[part])
        else:  # soft shadows need the whole band
            hits = layer.meet(directions)
            _over(samples, _shaded(layer, directions, hits), hits.mask, 1.0)
            _over(samples, 0.35 * hits.colour, edge_mask(hits), 0.6)
            nearest = hits.depth
    return samples


def _lay_ghost(samples: Floats, layer: Layer, directions: Floats, nearest: Floats) -> None:
    """Lay one translucent robot over the picture wherever it is in front of what is solid."""
    hits = layer.meet(directions)
    # Half of the light is flat: a ghost should read as one thing, not as a second shaded machine.
    lit = lit_colours(layer.camera, directions, hits)
    in_front = hits.mask & (hits.depth < nearest - np.float32(_TOUCHING_M))
    _over(samples, 0.5 * (lit + hits.colour), in_front, layer.bodies[0].opacity)
    _over(samples, 0.5 * hits.colour, edge_mask(hits) & in_front, 0.75)


def _shaded(layer: Layer, directions: Floats, hits: Hits) -> Floats:
    """Shade solid bodies; the slow part, blocked light, is computed for one sample a pixel."""
    coarse = slice(None, None, _SAMPLES), slice(None, None, _SAMPLES)
    reach = 0.16 * view_height(layer.camera)
    daylight = layer.daylight(directions[coarse], hits.every(_SAMPLES), reach)
    fine = [array.repeat(_SAMPLES, axis=0).repeat(_SAMPLES, axis=1) for array in daylight]
    return lit_colours(layer.camera, directions, hits, fine)


def _over(below: Floats, above: Floats, where: BoolArray, opacity: float) -> None:
    """Blend one picture over another, in place, where the mask says so."""
    below[where] += np.float32(opacity) * (above[where] - below[where])


def _background(view: View, top: int, rows: int) -> Floats:
    """Return a pale sky that gets lighter towards the lower edge of the picture."""
    down = (np.arange(top, top + rows, dtype=np.float32) / view.rows)[:, None, None]
    high, low = (np.array(colour, dtype=np.float32) for colour in (SKY_TOP, SKY_BOTTOM))
    return np.ascontiguousarray(np.broadcast_to(high + down * (low - high), (rows, view.columns, 3)))


def _label_arrows(picture: Image.Image, scene: Scene, view: View) -> None:
    """Write the length of each single arrow next to its tip, with a white outline to be readable over anything."""
    sheet = ImageDraw.Draw(picture, "RGBA")
    unit = _unit(picture.size)
    for item in scene.arrows:
        tails, tips = arrow_ends(scene, item, scene.first)
        if len(tails) > 1:
            continue
        tail, tip = view.project(np.concatenate([tails, tips]))
        left, right = sorted((float(tail[0]), float(tip[0])))
        if np.isfinite(right):
            label = f"{float(np.linalg.norm(at_step(item.vectors_m, scene.first))) * 1e3:.2f} mm"
            font, offset = _font(round(1.1 * unit), True), 1.3 * unit
            fits = right + offset + sheet.textlength(label, font) < view.columns
            sheet.text(
                (right + offset if fits else left - offset, float(tip[1])),
                label,
                font=font,
                fill=_bytes(tuple(0.8 * value for value in item.colour)),
                anchor="lm" if fits else "rm",
                stroke_width=max(2, unit // 5),
                stroke_fill=_WHITE,
            )


def _panel(scene: Scene, size: tuple[int, int]) -> tuple[int, Callable[[Image.Image], None]]:
    """Return the right end of the box in the upper left corner, in pixels, and a function that draws it.

    It holds title, legend, table and scale. Letters grow with the picture, so that it can be shown at any size.
    """
    step, unit, entries, scale = scene.steps[scene.first], _unit(size), legend(scene), exaggeration_text(scene)
    title, plain, bold = _font(round(1.1 * unit), True), _font(unit), _font(unit, True)
    pad, line, rule, swatch = round(0.9 * unit), round(1.5 * unit), round(0.55 * unit), round(1.9 * unit)
    what, figure = (max((plain.getlength(row[k]) for row in step.caption), default=0.0) for k in (0, 1))
    words = [swatch + plain.getlength(entry.words) for entry in entries]
    narrow = max(0.3 * size[0], bold.getlength(scale), what + 1.6 * unit + figure, *words)
    heading = [*_wrapped(scene.title, title, narrow), *_wrapped(step.label, title, narrow)]
    left, top = unit + pad, unit + pad
    end = round(unit + max([narrow, *map(title.getlength, heading)]) + 2 * pad)

    def write(picture: Image.Image) -> None:
        sheet, right, y = ImageDraw.Draw(picture, "RGBA"), end - pad, top

        def ruled(y: int) -> int:
            """Draw a thin line across the box and return where the next words begin."""
            sheet.line((left, y + rule // 3, right, y + rule // 3), fill=_LINE, width=max(1, unit // 12))
            return y + rule

        rows = 1 + len(heading) + len(entries) + len(step.caption)
        height = 2 * pad + rows * line + rule * (2 if step.caption else 1)
        sheet.rounded_rectangle((unit, unit, end, unit + height), radius=pad // 2, fill=(*_WHITE, 219))
        for one in heading:
            sheet.text((left, y), one, font=title, fill=_INK)
            y += line
        y += round(0.3 * unit)
        for entry in entries:
            _sign(sheet, entry, left, y, unit)
            sheet.text((left + swatch, y), entry.words, font=plain, fill=_INK)
            y += line
        y = ruled(y) if step.caption else y
        for name, value in step.caption:
            sheet.text((left, y), name, font=plain, fill=_SOFT_INK)
            sheet.text((right, y), value, font=plain, fill=_INK, anchor="ra")
            y += line
        sheet.text((left, ruled(y)), scale, font=bold, fill=_INK)

    return end, write


def _sign(sheet: ImageDraw.ImageDraw, entry: LegendEntry, left: int, y: int, unit: int) -> None:
    """Draw the sign before the text of a legend line."""
    width, height, top = round(1.4 * unit), round(0.8 * unit), y + round(0.22 * unit)
    fill = (*_bytes(entry.colour), round(255 * entry.opacity))
    if not entry.is_arrow:
        sheet.rectangle((left, top, left + width, top + height), fill=fill, outline=(*_INK, 150))
        return
    middle, neck = top + height / 2, left + 0.55 * width
    sheet.line((left, middle, neck, middle), fill=fill, width=max(2, height // 4))
    sheet.polygon([(neck, top), (left + width, middle), (neck, top + height)], fill=fill)


def _wrapped(words: str, font: ImageFont.FreeTypeFont, width: float) -> list[str]:
    """Return the words in lines that are no wider than ``width``, where the words allow it."""
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
    """Return the typeface that comes with matplotlib: the same on every machine."""
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name), size)
