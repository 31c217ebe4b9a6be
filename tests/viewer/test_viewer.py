"""The page and the live view."""

import base64
import gc
import html.parser
import json
import re
import shutil
import socket
import subprocess
import sys
import threading
import time
import urllib.request

import numpy as np
import pinocchio as pin
import psutil
import pytest
import umsgpack
from PIL import Image
from tornado.httpclient import HTTPClientError, HTTPRequest
from tornado.ioloop import IOLoop
from tornado.websocket import websocket_connect

from pouring_robot.exceptions import BadInputError, DescriptionError, OutputError
from pouring_robot.viewer import (
    Camera,
    Scene,
    SceneArrow,
    SceneRobot,
    camera_on,
    exaggeration_text,
    serve,
    solids,
    visual_model,
    write_html,
)
from pouring_robot.viewer.solids import SHARED
from tests.viewer.scenes import URDF, small_scene


class _Outline(html.parser.HTMLParser):
    """Collects what a page refers to and the words of its overlay."""

    def __init__(self):
        super().__init__()
        self.references, self.words, self.open = [], [], []

    def handle_starttag(self, tag, attributes):
        self.references += [value for name, value in attributes if name in ("src", "href", "action", "data")]
        if tag not in ("meta", "input"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "section" in self.open:
            self.words.append(data)


@pytest.fixture(name="page")
def _page(tmp_path):
    return write_html(small_scene(tmp_path), tmp_path / "view.html").read_text()


def _commands(page):
    packed = re.search(r'<script id="drawing-commands"[^>]*>(.*?)</script>', page, re.DOTALL).group(1)
    return [umsgpack.unpackb(base64.b64decode(one)) for one in json.loads(packed)]


def _transforms(commands):
    return {one["path"]: np.array(one["matrix"]).reshape(4, 4).T for one in commands if one["type"] == "set_transform"}


def test_page_is_whole_and_refers_to_nothing_outside(page):
    outline = _Outline()
    outline.feed(page)
    outline.close()
    assert outline.open == []
    assert outline.references == []
    own = page.replace(re.search(r"<script>(?:.{100000,}?)</script>", page, re.DOTALL).group(0), "")
    assert "http" not in own.replace("http-equiv", "")
    assert "127.0.0.1" not in page
    assert "connect-src 'none'" in page
    # Names of XML dialects are all that the viewer's own script holds; they are never fetched.
    assert set(re.findall(r"https?://[^\"'` )]*", page)) == {"http://www.w3.org/1999/xhtml"}
    assert 800_000 < len(page) < 3_000_000


def test_overlay_says_what_is_seen_and_how_far_it_is_stretched(page):
    outline = _Outline()
    outline.feed(page)
    words = " ".join(outline.words)
    for text in ("Where is <the> cup?", "nominal", "actual: closed & checked", "error: 7.1 mm", "gap"):
        assert text in words
    assert "errors drawn 20 × larger than they are" in words
    assert "<the>" not in page  # escaped wherever it stands


def test_labels_hang_on_their_arrows(page, tmp_path):
    assert 'data-group="error" data-tail="1.0 2.0 -0.4" data-tip="1.1 2.1 -0.4"' in page
    outline = _Outline()
    outline.feed(page)
    assert "7.1 mm" in outline.words  # by itself, besides the line of the legend
    # Of many arrows only the longest has its length written beside it.
    start = np.zeros(3)
    arrows = tuple(SceneArrow(f"error {k}", start, start + k * 0.1, label=f"{k} mm") for k in range(1, 9))
    crowd = write_html(small_scene(tmp_path, arrows=arrows), tmp_path / "many.html").read_text()
    assert re.findall(r'data-group="([^"]*)" data-tail', crowd) == ["error 8"]


def test_exaggeration_of_one_is_true_scale(tmp_path):
    assert exaggeration_text(small_scene(tmp_path, exaggeration=1.0)) == "drawn to scale"


def test_both_robots_stand_where_pinocchio_puts_them(page, tmp_path):
    transforms = _transforms(_commands(page))
    scene = small_scene(tmp_path)
    for robot in scene.robots:
        data, placed = robot.model.createData(), robot.visual.createData()
        pin.forwardKinematics(robot.model, data, np.array(robot.configuration))
        pin.updateGeometryPlacements(robot.model, data, robot.visual, placed)
        for item, pose in zip(robot.visual.geometryObjects, placed.oMg, strict=True):
            path = f"/scene/{robot.name}/{item.name}"
            if item.name.startswith("trolley"):  # stands still, so it is drawn once, for both
                assert path not in transforms
                path = f"/scene/{SHARED}/{item.name}"
            np.testing.assert_allclose(transforms[path], pose.homogeneous, atol=1e-12)
    np.testing.assert_allclose(transforms["/scene"][:3, 3], -camera_on(scene).target_m)


def test_nominal_is_translucent_and_actual_is_not(page):
    opacity = {
        one["path"]: one["object"]["materials"][0]["opacity"]
        for one in _commands(page)
        if one["type"] == "set_object" and one["path"].endswith("surface")
    }
    assert {value for path, value in opacity.items() if "/nominal/" in path} == {0.35}
    assert {value for path, value in opacity.items() if "/actual/" in path} == {1.0}
    assert sum("/error/" in path for path in opacity) == 2
    assert sum("/lip/" in path for path in opacity) == 3


def test_same_scene_gives_the_same_bytes(page, tmp_path):
    assert write_html(small_scene(tmp_path), tmp_path / "again.html").read_text() == page


def test_meshes_are_scaled(tmp_path):
    cup = next(body for body in solids(small_scene(tmp_path)) if body.link == "cup")
    np.testing.assert_allclose(np.ptp(cup.shape.vertices, axis=0), (0.3, 0.2, 0.1), atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(cup.shape.normals, axis=1), 1.0)
    assert len(cup.shape.edges) == 12


def test_arrows_point_from_tail_to_tip(tmp_path):
    start, end = np.array([0.1, 0.2, 0.3]), np.array([-0.4, 0.6, 0.1])
    for tip in (end, start + 5e-3, start):
        scene = small_scene(tmp_path, arrows=(SceneArrow("error", start, tip),))
        points = np.concatenate([body.vertices_in_world() for body in solids(scene) if body.group == "error"])
        along = (points - start) @ (end - start) / np.linalg.norm(end - start)
        assert np.linalg.norm(points - tip, axis=1).min() < (1e-9 if tip is not start else 0.03)
        if tip is end:
            assert along.min() == pytest.approx(0.0, abs=1e-9)
            assert along.max() == pytest.approx(np.linalg.norm(end - start))


def test_refuses_scenes_that_make_no_sense(tmp_path):
    scene = small_scene(tmp_path)
    robot = scene.robots[0]
    with pytest.raises(BadInputError, match="shape"):
        SceneRobot("a", robot.model, robot.visual, np.zeros(3))
    with pytest.raises(BadInputError, match="opacity"):
        SceneRobot("a", robot.model, robot.visual, robot.configuration, opacity=0.0)
    with pytest.raises(BadInputError, match="twice"):
        Scene("t", (robot, robot))
    with pytest.raises(BadInputError, match="no robot"):
        Scene("t", ())
    with pytest.raises(BadInputError, match="exaggeration"):
        Scene("t", (robot,), exaggeration=0.0)
    with pytest.raises(BadInputError, match="'/'"):
        SceneArrow("a/b", np.zeros(3), np.ones(3))
    with pytest.raises(BadInputError, match="three finite"):
        SceneArrow("a", np.zeros(3), np.array([0.0, np.nan, 0.0]))
    with pytest.raises(BadInputError, match="straight"):
        Camera(np.array([0.0, 0.0, 1.0]), np.zeros(3))


def test_missing_mesh_is_named(tmp_path):
    with pytest.raises(DescriptionError, match=r"cup\.stl"):
        visual_model(pin.buildModelFromXML(URDF), URDF, [tmp_path])


def test_unwritable_place_is_one_line(tmp_path):
    with pytest.raises(OutputError, match="does not exist"):
        write_html(small_scene(tmp_path), tmp_path / "no" / "view.html")


def _listening():
    return [one for one in psutil.Process().net_connections("inet") if one.status == psutil.CONN_LISTEN]


def test_live_view_listens_on_loopback_alone_and_leaves_nothing(tmp_path, capfd):
    threads, children = set(threading.enumerate()), psutil.Process().children(recursive=True)
    before = {one.laddr.port for one in _listening()}
    with serve(small_scene(tmp_path)) as view:
        opened = [one for one in _listening() if one.laddr.port not in before]
        assert [one.laddr.ip for one in opened] == ["127.0.0.1"]
        assert view.url == f"http://127.0.0.1:{opened[0].laddr.port}/"
        assert psutil.Process().children(recursive=True) == children
        for address in (view.url, view.url + "static/"):
            with urllib.request.urlopen(address, timeout=5) as answer:
                assert "Where is &lt;the&gt; cup?" in answer.read().decode()
        with pytest.raises(urllib.error.HTTPError):
            urllib.request.urlopen(view.url + "favicon.ico", timeout=5)
        port = opened[0].laddr.port
    assert {one.laddr.port for one in _listening()} == before
    assert set(threading.enumerate()) == threads
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", port), timeout=2)
    assert view.wait(0.0)
    view.close()
    assert capfd.readouterr() == ("", "")


def test_live_view_sends_the_scene_and_its_successor(tmp_path):
    async def messages(url, count):
        client = await websocket_connect(url.replace("http", "ws") + "commands")
        try:
            got = [await client.read_message() for _ in range(count)]
            view.show(small_scene(tmp_path, title="second"))
            while (message := await client.read_message()) is not None:
                got.append(message)
                if isinstance(message, str):
                    break
        finally:
            client.close()
        return got

    first = _commands(write_html(small_scene(tmp_path), tmp_path / "view.html").read_text())
    with serve(small_scene(tmp_path)) as view:
        got = IOLoop(make_current=False).run_sync(lambda: messages(view.url, len(first) + 2), timeout=10)
    assert umsgpack.unpackb(got[0]) == {"type": "delete", "path": "/scene"}
    assert "Where is" in got[1]
    assert [umsgpack.unpackb(one) for one in got[2:-2]] == first
    assert "second" in got[-1]


def test_live_view_refuses_pages_of_other_origins_and_names(tmp_path):
    async def ask(url, **headers):
        await websocket_connect(HTTPRequest(url.replace("http", "ws") + "commands", headers=headers))

    with serve(small_scene(tmp_path)) as view:
        loop = IOLoop(make_current=False)
        with pytest.raises(HTTPClientError, match="403"):
            loop.run_sync(lambda: ask(view.url, Origin="http://elsewhere.example"), timeout=10)
        # A foreign name that was made to point at this machine.
        with pytest.raises(HTTPClientError, match="404"):
            loop.run_sync(
                lambda: ask(view.url, Origin="http://elsewhere.example", Host="elsewhere.example"), timeout=10
            )


def test_a_taken_port_is_one_line(tmp_path):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        with pytest.raises(BadInputError, match="choose another port") as caught:
            serve(small_scene(tmp_path), port=other.getsockname()[1])
    assert "\n" not in str(caught.value)
    with pytest.raises(BadInputError, match="choose another port"):
        serve(small_scene(tmp_path), port=70000)
    gc.collect()  # a socket left open would warn here


def test_a_server_that_does_not_start_is_one_line_and_leaves_nothing(tmp_path, monkeypatch):
    def broken(application):
        raise OSError("no more file descriptors")

    def slow(application):
        time.sleep(0.5)
        raise OSError("too late")

    threads, before = set(threading.enumerate()), _listening()
    monkeypatch.setattr("tornado.httpserver.HTTPServer", broken)
    with pytest.raises(BadInputError, match=r"cannot show the page.*no more file descriptors") as caught:
        serve(small_scene(tmp_path))
    assert "\n" not in str(caught.value)
    monkeypatch.setattr("tornado.httpserver.HTTPServer", slow)
    monkeypatch.setattr("pouring_robot.viewer.live._PATIENCE_S", 0.1)
    with pytest.raises(BadInputError, match=r"did not start within 0\.1 s"):
        serve(small_scene(tmp_path))
    for thread in set(threading.enumerate()) - threads:
        thread.join(5)
    assert _listening() == before
    assert set(threading.enumerate()) == threads


def test_live_view_ends_with_ctrl_c_and_with_its_program(tmp_path):
    program = (
        "import pathlib, signal, sys\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # even where it is inherited as ignored
        "from pouring_robot.viewer import serve\n"
        "from tests.viewer.scenes import small_scene\n"
        "try:\n"
        f"    with serve(small_scene(pathlib.Path({str(tmp_path)!r}))) as view:\n"
        "        print(view.url, flush=True)\n"
        "        view.wait()\n"
        "except KeyboardInterrupt: sys.exit(7)\n"
    )
    for end, code in (("send_signal", 7), ("kill", -9)):
        with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as process:
            port = int(process.stdout.readline().rsplit(":", 1)[1].strip("/\n"))
            socket.create_connection(("127.0.0.1", port), timeout=5).close()
            getattr(process, end)(*([2] if end == "send_signal" else []))
            try:
                assert process.wait(10) == code
            finally:
                process.kill()
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(("127.0.0.1", port), timeout=2)


@pytest.mark.skipif(shutil.which("chromium") is None, reason="needs chromium, which no Python package brings")
def test_a_browser_draws_the_page(page, tmp_path):
    (tmp_path / "view.html").write_text(page)
    options = "--headless --no-sandbox --disable-gpu --use-angle=swiftshader --enable-unsafe-swiftshader"
    command = ["chromium", *options.split(), f"--user-data-dir={tmp_path / 'profile'}"]
    command += ["--virtual-time-budget=4000", "--window-size=800,600", "--enable-logging=stderr"]
    command += [f"--screenshot={tmp_path / 'shot.png'}", (tmp_path / "view.html").as_uri()]
    run = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert not re.search(r"CONSOLE.*(Error|Refused|violates)", run.stderr)
    pixels = np.asarray(Image.open(tmp_path / "shot.png").convert("RGB")).astype(int)
    red = (pixels[..., 0] > 150) & (pixels[..., 1] < 70) & (pixels[..., 2] < 70)
    assert red[:, 400:].any()  # the arrow, not its sign in the legend
