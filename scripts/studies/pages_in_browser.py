"""Every kind of page in Chromium, at 1400 and 400 pixels, light and dark: its appearance and its speed.

    .venv/bin/python -m scripts.studies.pages_in_browser --out shots [--poses 500]

Uses Chromium's own protocol, so no other package is needed. Checks that the console has no messages and nothing
external is requested, that nothing extends beyond the window, that no panel covers the picture, that dark mode is
respected, that pages play and sliders move the robot. Reports the size of a page, its time to open, the frames per
second it plays, and the cost of a frame in the graphics process (without a graphics card that is software). Exit code
1: a check failed. Screenshots of everything are saved in the folder.
"""

from __future__ import annotations

import argparse
import asyncio
import base64
import itertools
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from tornado.httpclient import AsyncHTTPClient
from tornado.websocket import WebSocketClientConnection, websocket_connect

from pouring_robot import load_robot
from pouring_robot.campaign.data import Campaign
from pouring_robot.diagnosis.report.modelled_and_measured import campaign_scene
from pouring_robot.robot.heat_section import HeatSection
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.view.nominal_and_actual import pose_scene
from pouring_robot.thermal.network.history import HeatHistory, PoseSchedule
from pouring_robot.thermal.report import ShiftHeat, heated_drawing
from pouring_robot.thermal.scene import PouringBench, shift_scene
from pouring_robot.viewer import Scene, serve, write_html

ROOT = Path(__file__).parents[2]
SIZES, SCHEMES = ((1400, 900), (400, 800)), ("light", "dark")
OPTIONS = "--headless --no-sandbox --use-angle=swiftshader --enable-unsafe-swiftshader --remote-debugging-port=0"
PLAYED_S = 5.0


@contextmanager
def chromium() -> Iterator[tuple[str, psutil.Process]]:
    """Run a browser, and give the address it listens at and its process."""
    with tempfile.TemporaryDirectory() as profile:
        command = ["chromium", *OPTIONS.split(), f"--user-data-dir={profile}", "about:blank"]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
            try:
                told = Path(profile) / "DevToolsActivePort"
                while not (told.exists() and told.read_text().count("\n")):
                    time.sleep(0.1)
                yield f"http://127.0.0.1:{told.read_text().split()[0]}", psutil.Process(process.pid)
            finally:
                process.terminate()
                process.wait(20)


class Tab:
    """One page of the browser.

    Attributes:
        said: what the console said, and what was asked for from elsewhere.
    """

    def __init__(self, socket: WebSocketClientConnection, own: str) -> None:
        """Listen; ``own`` begins the addresses that a page may ask for."""
        self._socket, self._own, self._numbers = socket, own, itertools.count(1)
        self.said: list[str] = []

    async def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Return the result of a command, keeping what happens meanwhile."""
        number = next(self._numbers)
        await self._socket.write_message(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            message = await self._socket.read_message()
            if message is None:
                raise RuntimeError("the browser has gone")
            event = json.loads(message)
            if event.get("id") == number:
                return dict(event.get("result", {}))
            self._note(event)

    def _note(self, event: dict[str, Any]) -> None:
        told = event.get("params", {})
        if event.get("method") == "Runtime.exceptionThrown":
            self.said.append(str(told["exceptionDetails"].get("exception", {}).get("description", "exception")))
        elif event.get("method") == "Log.entryAdded" and told["entry"]["level"] in ("error", "warning"):
            text = told["entry"]["text"]
            if "GPU stall due to ReadPixels" not in text and "favicon" not in str(told["entry"].get("url")):
                self.said.append(text)
        elif event.get("method") == "Network.requestWillBeSent":
            address = told["request"]["url"]
            if not address.startswith((self._own, "data:", "blob:")):
                self.said.append(f"asked for {address}")

    async def run(self, script: str) -> Any:
        """Return the value of a script."""
        found = await self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in found:
            raise RuntimeError(found["exceptionDetails"]["exception"]["description"])
        return found["result"].get("value")

    async def shot(self, file: Path) -> None:
        """Write a screenshot."""
        file.write_bytes(base64.b64decode((await self.call("Page.captureScreenshot"))["data"]))


LAYOUT = """(() => {
  const wide = [...document.querySelectorAll('body *')].filter(e => e.getBoundingClientRect().right > innerWidth + 1
    && !e.closest('svg') && getComputedStyle(e).display !== 'none' && !e.closest('.dg'));
  const box = pane.getBoundingClientRect();
  const spots = [[.5, .5], [.1, .1], [.9, .9], [.1, .9]].map(([x, y]) =>
    document.elementFromPoint(box.left + x * box.width, box.top + y * box.height));
  const small = [...document.querySelectorAll('#panel *, #bar *')].filter(e => e.textContent.trim() &&
    parseFloat(getComputedStyle(e).fontSize) < 11);
  const back = getComputedStyle(document.getElementById('panel')).backgroundColor.match(/\\d+/g).map(Number);
  return {wide: wide.map(e => e.tagName + '.' + e.className), small: small.length,
    covered: spots.filter(e => !e || e.tagName !== 'CANVAS').length, dark: Math.max(...back.slice(0, 3)) < 100,
    share: box.width * box.height / innerWidth / innerHeight};
})()"""
DRAWN = "typeof viewer !== 'undefined' && Boolean(viewer) && viewer.renderer.info.render.frame > 0"
SLIDE = """new Promise(done => {
  const old = socket.onmessage, begun = performance.now();
  socket.onmessage = message => {
    socket.onmessage = old;
    old(message);
    requestAnimationFrame(() => requestAnimationFrame(() => done(performance.now() - begun)));
  };
  const range = document.querySelectorAll('#bench input[type=range]')[%d];
  range.value = Number(range.min) + %f * (range.max - range.min);
  range.dispatchEvent(new Event('input'));
})"""


async def seen(base: str, browser: psutil.Process, name: str, address: str, out: Path) -> list[str]:
    """Look at one page in every size and scheme, print what was measured, and return what does not hold."""
    wrong = []
    for size, scheme in itertools.product(SIZES, SCHEMES):
        (tab, opened), width = await _open(base, address, size, scheme), size[0]
        found = await tab.run(LAYOUT)
        line = f"{name:12} {width:5} {scheme:5}  open {opened:4.1f} s  picture {found['share']:3.0%} of the window"
        if scheme == "light":
            line += await _played(tab, browser) + await _slid(tab)
        await tab.shot(out / f"{name}_{width}_{scheme}.png")
        print(line, flush=True)
        faults = [
            *tab.said,
            *(f"reaches beyond the window: {what}" for what in found["wide"]),
            *(["the panel lies over the picture"] if found["covered"] else []),
            *(["letters below 11 pixels"] if found["small"] else []),
            *(["the scheme is not honoured"] if found["dark"] != (scheme == "dark") else []),
        ]
        wrong += [f"{name} at {width}, {scheme}: {fault}" for fault in faults]
        await tab.call("Page.close")
    return wrong


async def _open(base: str, address: str, size: tuple[int, int], scheme: str) -> tuple[Tab, float]:
    """Open a page, and return it once it has drawn, and after how many seconds."""
    answer = await AsyncHTTPClient().fetch(f"{base}/json/new?about:blank", method="PUT", body="")
    socket = await websocket_connect(json.loads(answer.body)["webSocketDebuggerUrl"], max_message_size=1 << 28)
    tab = Tab(socket, address.split("#", maxsplit=1)[0])
    for domain in ("Page", "Runtime", "Log", "Network"):
        await tab.call(f"{domain}.enable")
    metrics = {"width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": size[0] < 700}
    await tab.call("Emulation.setDeviceMetricsOverride", **metrics)
    await tab.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
    begun = time.perf_counter()
    await tab.call("Page.navigate", url=address)
    while not await tab.run(DRAWN):
        await asyncio.sleep(0.05)
    return tab, time.perf_counter() - begun


async def _played(tab: Tab, browser: psutil.Process) -> str:
    """Play a page that plays, and return how fast."""
    if not await tab.run("Boolean(document.getElementById('play'))"):
        return ""
    frame, place = "viewer.renderer.info.render.frame", await tab.run("at")
    await tab.run("document.getElementById('play').click()")
    first, begun, work = await tab.run(frame), time.perf_counter(), _graphics_s(browser)
    await asyncio.sleep(PLAYED_S)
    count, spent = await tab.run(frame) - first, time.perf_counter() - begun
    cost = 1e3 * (_graphics_s(browser) - work) / max(count, 1)
    moved = await tab.run("at") != place
    await tab.run("document.getElementById('play').click()")
    if not moved:
        tab.said.append("it does not play")
    return f"  {count / spent:4.1f} pictures/s, {cost:3.0f} ms of the graphics process each"


def _graphics_s(browser: psutil.Process) -> float:
    children = [child for child in browser.children(recursive=True) if "--type=gpu-process" in child.cmdline()]
    return sum(sum(child.cpu_times()[:2]) for child in children)


async def _slid(tab: Tab) -> str:
    """Move sliders of a bench, and return how long it took from slider to picture."""
    if not await tab.run("typeof bench !== 'undefined'"):
        return ""
    before = await tab.run("Array.from(robots[0].groups.get(8).matrix.elements)")
    took = [await tab.run(SLIDE % (number % 4, 0.3 + 0.01 * number)) for number in range(40)]
    if before == await tab.run("Array.from(robots[0].groups.get(8).matrix.elements)"):
        tab.said.append("the sliders do not move the robot")
    return f"  slider to picture {np.median(took):3.0f} ms (median), {np.percentile(took, 95):3.0f} ms (19 of 20)"


async def beside(bases: list[str], address: str) -> None:
    """Open a bench in two windows side by side, and print how they follow, one hand at a time and both at once."""
    tabs = [(await _open(base, address, (700, 900), "light"))[0] for base in bases]
    print(f"two benches, one hand {await _slid(tabs[0])}", flush=True)
    print(f"two benches, two hands{' and'.join(await asyncio.gather(*map(_slid, tabs)))}", flush=True)


def pour(count: int) -> list[PlatformPose]:
    """Return a pour across the workspace."""
    part = np.linspace(0.0, 1.0, count)
    x, y = -100.0 + 45.0 * np.sin(6.0 * part), 40.0 * np.sin(9.0 * part + 1.0)
    return [
        PlatformPose.from_mm_deg(*row) for row in zip(x, y, -780.0 + 300.0 * part, -20.0 + 75.0 * part**2, strict=True)
    ]


def scenes(count: int, work: Path) -> dict[str, Scene]:
    """Return a scene of every kind."""
    robot = load_robot(ROOT / "examples" / "actual.yaml")
    poses = pour(count)
    heated = heated_drawing(robot, HeatSection())
    history, times = HeatHistory.constant(1700.0, 20.0, 3600.0), np.linspace(0.0, 3600.0, 60)
    shift = ShiftHeat.of(heated.robot, heated.network, history, PoseSchedule.of(poses[0], 0.0), times)
    rig = [sys.executable, "-m", "tests.rig", "--out", str(work / "rig"), "--cases", "1", "--seed", "777"]
    subprocess.run(rig, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    rows = campaign_scene(Campaign.read(next((work / "rig").glob("*/campaign.csv"))), RobotModel())
    assert rows is not None
    return {
        "pose": pose_scene([robot.locate(poses[0])]),
        "path": pose_scene([robot.locate(pose) for pose in poses]),
        "shift": shift_scene(heated.robot, shift, "a shift"),
        "campaign": rows,
    }


def main() -> int:
    """Look at every page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder for pages and screenshots")
    parser.add_argument("--poses", type=int, default=500, help="poses of the path")
    arguments = parser.parse_args()
    out: Path = arguments.out
    out.mkdir(parents=True, exist_ok=True)
    wrong: list[str] = []
    with tempfile.TemporaryDirectory() as work, chromium() as (base, browser):
        for name, scene in scenes(arguments.poses, Path(work)).items():
            page = write_html(scene, out / f"{name}.html")
            print(f"{name}: {page.stat().st_size / 1e6:.2f} MB, {len(scene.steps)} steps", flush=True)
            wrong += asyncio.run(seen(base, browser, name, page.absolute().as_uri(), out))
        robot = load_robot(ROOT / "examples" / "actual.yaml")
        bench = PouringBench(robot, robot.location_in_the_middle())
        with serve(bench.scene, bench=bench) as view:
            wrong += asyncio.run(seen(base, browser, "bench", view.url, out))
            with chromium() as (other, _):
                asyncio.run(beside([base, other], view.url))
    print("\n".join(wrong) or "everything holds")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
