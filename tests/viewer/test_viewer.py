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
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import psutil
import pytest
from PIL import Image
from tornado.httpclient import HTTPClientError, HTTPRequest
from tornado.ioloop import IOLoop
from tornado.websocket import websocket_connect

import pouring_robot.viewer.page as page_module
from pouring_robot.exceptions import BadInputError, DescriptionError, OutputError
from pouring_robot.viewer import (
    Camera,
    Scene,
    SceneArrows,
    Step,
    enlarged,
    exaggeration_text,
    serve,
    solids,
    visual_model,
    write_html,
)
from tests.viewer.scenes import URDF, film, small_scene

needs_browser = pytest.mark.skipif(
    shutil.which("chromium") is None, reason="needs chromium, which no Python package brings"
)


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


def _content(page):
    return json.loads(re.search(r'<script id="content"[^>]*>(.*?)</script>', page, re.DOTALL).group(1))


def _unpacked(text, width):
    return np.frombuffer(base64.b64decode(text), "<f4").reshape(-1, width).astype(float)


def _drawn(content, robot, body, step, factor):
    """Return where a page's script puts a body, from what the page holds: the formula at the head of page.js."""
    packed = content["film"]["robots"][robot]
    place, error = (_unpacked(packed[key][body], width) for key, width in (("places", 7), ("errors", 6)))
    place, error = (one[min(step, len(one) - 1)] for one in (place, error))
    turn = pin.exp3(factor * error[3:]) @ pin.Quaternion(place[3:]).normalized().matrix()
    return pin.SE3(turn, place[:3] + factor * error[:3]).homogeneous


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
    assert 800_000 < len(page) < 2_000_000


def test_panel_says_what_is_seen(page):
    outline = _Outline()
    outline.feed(page)
    words = " ".join(outline.words)
    for text in ("Where is <the> cup?", "nominal", "actual: closed & checked", "error: of the cup", "gap", "7.1 mm"):
        assert text in words
    assert "<the>" not in page  # escaped wherever it stands


def test_what_nothing_enlarges_is_not_offered(page, tmp_path):
    still = small_scene(tmp_path, arrows=(), exaggeration=1.0)
    factor = r'<input id="factor"[^>]*( hidden)>'
    assert re.search(factor, write_html(still, tmp_path / "still.html").read_text())
    assert not re.search(factor, page)


def test_exaggeration_of_one_is_true_scale(tmp_path):
    assert exaggeration_text(small_scene(tmp_path, exaggeration=1.0)) == "drawn to scale"


@pytest.mark.parametrize("factor", [1.0, 20.0, 200.0])
def test_a_page_holds_every_body_at_every_step(tmp_path, factor):
    scene = film(tmp_path)
    content = _content(write_html(scene, tmp_path / "film.html").read_text())
    for robot, packed in zip(scene.robots, content["robots"], strict=True):
        for item, visual in zip(robot.visual.geometryObjects, packed["visuals"], strict=True):
            assert (visual["name"], visual["body"]) == (item.name, item.parentJoint)
            np.testing.assert_allclose(np.reshape(visual["matrix"], (4, 4)).T, item.placement.homogeneous, atol=1e-12)
        for step in range(len(scene.steps)):
            places = robot.bodies[step]
            if robot.reference is not None:
                places = enlarged(places, robot.reference[step], factor)
            for body, place in enumerate(places):
                drawn = _drawn(content, robot.name, body, step, factor)
                np.testing.assert_allclose(drawn, place, atol=1e-6 * max(1.0, factor / 20.0))
    assert len(_unpacked(content["film"]["robots"]["actual"]["places"][1], 7)) == 1  # it stands still: said once


def test_what_a_page_plays(tmp_path):
    page = write_html(film(tmp_path), tmp_path / "film.html").read_text()
    content = _content(page)["film"]
    assert [step["label"] for step in content["steps"]] == ["step 0", "step 1", "step 2", "step 3"]
    assert content["steps"][2]["caption"] == [["number", "2"]]
    assert content["at"] == [0.0, 1.0, 4.0, 9.0]
    (curve,) = content["curves"]
    np.testing.assert_allclose(curve["values"], np.sqrt(2.0) * np.arange(4))
    assert 'id="time"' in page and 'id="curves"' in page
    buttons = write_html(film(tmp_path, axis="", curves=()), tmp_path / "rows.html").read_text()
    assert 'id="time"' not in buttons
    assert re.findall(r'data-step="(\d)">([^<]*)<', buttons)[1] == ("1", "step 1")


def test_enlarging_by_hand():
    place, reference = np.eye(4), np.eye(4)
    reference[:3, :3], reference[:3, 3] = pin.utils.rotate("y", 0.3), (1.0, 2.0, 3.0)
    place[:3, :3] = pin.utils.rotate("z", 0.01) @ reference[:3, :3]
    place[:3, 3] = (1.001, 2.0, 2.998)
    drawn = enlarged(place[None], reference[None], 100.0)[0]
    np.testing.assert_allclose(drawn[:3, 3], (1.1, 2.0, 2.8), atol=1e-12)
    np.testing.assert_allclose(drawn[:3, :3], pin.utils.rotate("z", 1.0) @ reference[:3, :3], atol=1e-12)


def test_solid_bodies_stand_where_pinocchio_puts_them(tmp_path):
    scene = small_scene(tmp_path)
    found = {(body.group, body.name): body for body in solids(scene)}
    # The trolley stands still, so the translucent robot's is left out: no gap looks like no gap.
    assert ("nominal", "trolley_0") not in found and ("actual", "trolley_0") in found
    for robot in scene.robots:
        for item in robot.visual.geometryObjects:
            if (body := found.get((robot.name, item.name))) is not None:
                wanted = robot.bodies[0, item.parentJoint] @ item.placement.homogeneous
                np.testing.assert_allclose(body.pose_world_to_solid, wanted, atol=1e-12)
                assert body.opacity == robot.opacity


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
        arrow = SceneArrows("error", start[None, None], (tip - start)[None, None] / 20.0)
        scene = small_scene(tmp_path, arrows=(arrow,))
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
        replace(robot, bodies=np.zeros((1, 2, 4, 4)))
    with pytest.raises(BadInputError, match="not finite"):
        replace(robot, bodies=np.full((1, 3, 4, 4), np.nan))
    with pytest.raises(BadInputError, match="opacity"):
        replace(robot, opacity=0.0)
    with pytest.raises(BadInputError, match="twice"):
        Scene("t", (robot, robot))
    with pytest.raises(BadInputError, match="no robot"):
        Scene("t", ())
    with pytest.raises(BadInputError, match="exaggeration"):
        Scene("t", (robot,), exaggeration=0.0)
    with pytest.raises(BadInputError, match=r"'at' has 2 entries, the scene 1 steps"):
        Scene("t", (robot,), at=np.arange(2.0))
    with pytest.raises(BadInputError, match="no step 1"):
        Scene("t", (robot,), first=1)
    with pytest.raises(BadInputError, match="'/'"):
        SceneArrows("a/b", np.zeros((1, 1, 3)), np.ones((1, 1, 3)))
    with pytest.raises(BadInputError, match="finite numbers"):
        SceneArrows("a", np.zeros((1, 1, 3)), np.full((1, 1, 3), np.nan))
    with pytest.raises(BadInputError, match="straight"):
        Camera(np.array([0.0, 0.0, 1.0]), np.zeros(3))


@pytest.mark.parametrize("content", [None, "version https://git-lfs.github.com/spec/v1\nsize 22\n"])
def test_missing_mesh_is_named(tmp_path, content):
    folder = tmp_path / "a b"
    urdf = URDF.replace("package:/", str(folder))
    for name in re.findall('filename="(.+?)"', urdf) if content else ():
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_text(content, encoding="utf-8")
    with pytest.raises(DescriptionError, match=r"a b/.*cup\.stl: this mesh is missing or broken; put it there") as said:
        visual_model(pin.buildModelFromXML(URDF), urdf)
    assert "assimp" not in str(said.value)


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


class _Doubling:
    """A bench that doubles what it is asked."""

    def sliders(self):
        x = {"id": "x", "label": "x", "unit": "mm", "lower": 0, "upper": 1, "value": 0}
        errors = {"values": {}, "names": {}, "units": {}, "largest": {}}
        return {"groups": [{"name": "pose", "commands": True, "sliders": [x]}], "errors": errors}

    def answer(self, wanted):
        return {"doubled": 2 * wanted["x"]} if wanted else {"refused": "nothing"}


def test_a_bench_answers_its_page(tmp_path):
    async def ask(url):
        client = await websocket_connect(url.replace("http", "ws") + "bench")
        try:
            await client.write_message(json.dumps({"x": 21}))
            return json.loads(await client.read_message())
        finally:
            client.close()

    with serve(small_scene(tmp_path), bench=_Doubling()) as view:
        assert IOLoop(make_current=False).run_sync(lambda: ask(view.url), timeout=10) == {"doubled": 42}
        with urllib.request.urlopen(view.url, timeout=5) as answer:
            page = answer.read().decode()
    assert _content(page)["bench"]["groups"][0]["sliders"][0]["id"] == "x"
    assert "connect-src 'self'" in page


@pytest.mark.parametrize("message", ["nonsense", b"\xff\x00", 100_000 * "["])
def test_what_is_no_question_is_refused_and_the_next_is_answered(tmp_path, message, capfd):
    async def ask(url):
        client = await websocket_connect(url.replace("http", "ws") + "bench")
        try:
            await client.write_message(message, binary=isinstance(message, bytes))
            refused = await client.read_message()
            await client.write_message(json.dumps({"x": 21}))
            return [json.loads(refused), json.loads(await client.read_message())]
        finally:
            client.close()

    with serve(small_scene(tmp_path), bench=_Doubling()) as view:
        answers = IOLoop(make_current=False).run_sync(lambda: ask(view.url), timeout=10)
    assert answers == [{"refused": "nothing"}, {"doubled": 42}]
    assert capfd.readouterr() == ("", "")


def test_live_view_refuses_pages_of_other_origins_and_names(tmp_path):
    async def ask(url, **headers):
        await websocket_connect(HTTPRequest(url.replace("http", "ws") + "bench", headers=headers))

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
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        del caught  # which holds the frames that opened a socket
        gc.collect()
    assert not [one.message for one in seen if issubclass(one.category, ResourceWarning)]


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


def _browsed(page, folder, probe=""):
    """Return a screenshot's pixels (rows, columns, 3) and what a script added to the page wrote into the DOM."""
    shown = page.replace("</body>", f"<script>{{{probe}}}</script></body>")
    (folder / "view.html").write_text(shown)
    options = "--headless --no-sandbox --disable-gpu --use-angle=swiftshader --enable-unsafe-swiftshader"
    command = ["chromium", *options.split(), f"--user-data-dir={folder / 'profile'}"]
    command += ["--virtual-time-budget=4000", "--window-size=900,600", "--enable-logging=stderr", "--dump-dom"]
    command += [f"--screenshot={folder / 'shot.png'}", (folder / "view.html").as_uri()]
    run = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert not re.search(r"CONSOLE.*(Error|Refused|violates)", run.stderr)
    return np.asarray(Image.open(folder / "shot.png").convert("RGB")).astype(int), run.stdout


def test_scripts_of_a_page_give_no_name_twice():
    folder = Path(page_module.__file__).parent / "templates"
    text = "\n".join((folder / name).read_text() for name in ("page.js", "bench.js"))
    names = []
    for line in re.findall(r"^(?:const|let|function) (.*)", text, re.MULTILINE):
        names += re.findall(r"(?:^|, )([a-z_]\w*)(?= =|\()", line.split("=>")[0])
    assert len(names) > 40
    assert {name for name in names if names.count(name) > 1} == set()


@needs_browser
def test_a_browser_plays_and_tells(tmp_path):
    page = write_html(film(tmp_path), tmp_path / "film.html").read_text()
    probe = """
      go(2); speed = 1; at = 0; before = 0; play(100); const moved = at; speed = 0;
      const look = (width, height) => document.elementFromPoint(width, height).tagName;
      go(1); const box = pane.getBoundingClientRect();
      const made = document.createElement("pre"); made.id = "probe";
      made.textContent = JSON.stringify([moved, look(box.left + box.width / 2, box.height / 2), $("step").textContent,
        $("caption").innerText, document.querySelector("#keys output").textContent, states.length]);
      document.body.append(made);"""
    _, dom = _browsed(page, tmp_path, probe)
    moved, canvas, label, caption, figure, states = json.loads(re.search(r'<pre id="probe">(.*?)</pre>', dom).group(1))
    assert moved == pytest.approx(0.1)  # a tenth of a second later, where steps 0 and 1 are a second apart
    assert (canvas, label, caption.split(), figure, states) == ("CANVAS", "step 1", ["number", "1"], "1.41 mm", 0)


@needs_browser
def test_axes_point_where_the_camera_sees_them(tmp_path):
    """From each view, against the directions that point to the right and up there."""
    probe = """
      const seen = Object.entries(content.cameras).map(([name, { eye, target }]) => {
        look(name); viewer.controls.update(); viewer.camera.updateMatrixWorld(); place_words();
        const ends = axes.map(([line]) => line.getAttribute("d").match(/[-+.e\\d]+/g).map(Number).slice(2));
        return [eye, target, ends]; });
      const made = document.createElement("pre"); made.id = "probe"; made.textContent = JSON.stringify(seen);
      document.body.append(made);"""
    _, dom = _browsed(write_html(film(tmp_path), tmp_path / "film.html").read_text(), tmp_path, probe)
    seen = json.loads(re.search(r'<pre id="probe">(.*?)</pre>', dom).group(1))
    assert len(seen) > 2
    for eye, target, ends in seen:
        away = np.subtract(eye, target)
        right = np.cross([0.0, 0.0, 1.0], away) / np.hypot(away[0], away[1])
        up = np.cross(away, right) / np.linalg.norm(away)
        np.testing.assert_allclose(np.array(ends) / 10.0, np.column_stack([right, -up]), atol=2e-3)


@needs_browser
def test_between_two_steps_the_figure_is_that_of_the_step_that_is_told(tmp_path):
    """Halfway between 1.41 mm to the left and as much to the right stands no error of nothing."""
    vectors = np.array([[0.0, 0.0, 0.0], [0.0, 1e-3, 1e-3], [0.0, -1e-3, -1e-3], [0.0, 0.0, 0.0]])[:, None]
    scene = film(tmp_path)
    scene = replace(scene, arrows=(replace(scene.arrows[0], vectors_m=vectors),))
    probe = """
      const time = $("time"), told = () => [at, arrows[0].label.textContent, $("caption").innerText.split("\\t")[1]];
      go(1.6); const played = told();
      time.value = 1.4; time.dispatchEvent(new Event("input")); const dragged = told();
      const box = $("curves").getBoundingClientRect();
      $("curves").dispatchEvent(new PointerEvent("pointerdown", { clientX: box.left + 0.3 * box.width }));
      const pointed = told();
      go(0.6); play(0);
      const made = document.createElement("pre"); made.id = "probe";
      made.textContent = JSON.stringify([played, dragged, pointed, told()]); document.body.append(made);"""
    _, dom = _browsed(write_html(scene, tmp_path / "film.html").read_text(), tmp_path, probe)
    played, dragged, pointed, paused = json.loads(re.search(r'<pre id="probe">(.*?)</pre>', dom).group(1))
    assert played == [1.6, "1.41 mm", "2"]
    assert dragged == paused == [1, "1.41 mm", "1"]
    assert pointed == [2, "1.41 mm", "2"]  # 0.3 of 9 s is 2.7 s, and steps stand at 1 and 4 s


@needs_browser
def test_a_printed_page_has_its_picture(page, tmp_path):
    """What a browser prints is what the canvas still holds; the rest stands below it."""
    probe = """setTimeout(() => {
      const flat = element("canvas", { width: 1, height: 1 }).getContext("2d"), canvas = viewer.renderer.domElement;
      flat.drawImage(canvas, -canvas.width / 2, -10);
      const box = node => node.getBoundingClientRect(), shown = node => getComputedStyle(node).display !== "none";
      const made = document.createElement("pre"); made.id = "probe";
      made.textContent = JSON.stringify([flat.getImageData(0, 0, 1, 1).data[3], box(canvas).width / box(pane).width,
        box($("bar")).top >= box(canvas).bottom, box($("panel")).top >= box($("bar")).bottom,
        shown($("scale")), shown($("factor")), getComputedStyle(document.body).overflow]);
      document.body.append(made); }, 1000);"""
    _, dom = _browsed(page.replace("@media print", "@media all"), tmp_path, probe)
    found = json.loads(re.search(r'<pre id="probe">(.*?)</pre>', dom).group(1))
    assert found == [255, 1, True, True, True, False, "visible"]


@needs_browser
def test_a_browser_draws_the_page(page, tmp_path):
    pixels, dom = _browsed(page, tmp_path)
    red = (pixels[..., 0] > 150) & (pixels[..., 1] < 70) & (pixels[..., 2] < 70)
    assert red[:, 400:].any()  # the arrow, not its sign in the legend
    assert "errors drawn 20 × their size" in dom
    assert "7.07 mm" in dom


@needs_browser
def test_a_long_name_hides_no_figure(tmp_path):
    scene = small_scene(tmp_path, steps=(Step("", ((60 * "long_", "7.1 mm"),)),))
    probe = """const made = document.createElement("pre"); made.id = "probe"; document.body.append(made);
      made.textContent = $("panel").scrollWidth - $("panel").clientWidth;"""
    _, dom = _browsed(write_html(scene, tmp_path / "scene.html").read_text(), tmp_path, probe)
    assert '<pre id="probe">0</pre>' in dom


@needs_browser
def test_a_page_says_the_factor_that_the_picture_says(tmp_path):
    for factor in (125.0, 0.5):  # of what is drawn smaller, too
        scene = small_scene(tmp_path, exaggeration=factor)
        _, dom = _browsed(write_html(scene, tmp_path / "scene.html").read_text(), tmp_path)
        said = re.search(r'id="scale">(.*?)</output>', dom).group(1)
        assert said == exaggeration_text(scene) == f"errors drawn {factor:g} × their size"


@needs_browser
def test_a_number_that_is_being_typed_is_not_zero(tmp_path):
    sliders = _Doubling().sliders()
    sliders["groups"][0]["sliders"][0]["value"] = 0.5
    probe = """
      const typed = Array.from(["", "-", "0.25", ""], (value, k) => {
        const number = document.querySelector("#bench input[type=number]");
        number.value = value;
        number.dispatchEvent(new Event(k < 3 ? "input" : "change"));
        return [inputs.get("x").value(), number.value, wish && wish.values.x];
      });
      const made = document.createElement("pre"); made.id = "probe"; made.textContent = JSON.stringify(typed);
      document.body.append(made);"""
    page = page_module.page(small_scene(tmp_path), live=True, bench=sliders)
    _, dom = _browsed(re.sub(r"new WebSocket\(.*?\)", "{}", page), tmp_path, probe)
    typed = json.loads(re.search(r'<pre id="probe">(.*?)</pre>', dom).group(1))
    assert typed == [[0.5, "", None], [0.5, "", None], [0.25, "0.25", 0.25], [0.25, "0.25", 0.25]]


@needs_browser
def test_a_number_stands_whole_in_its_field(tmp_path):
    sliders = _Doubling().sliders()
    sliders["groups"][0]["sliders"][0] |= {"lower": -2000.0, "value": -1234.567}
    probe = """
      const made = document.createElement("pre"); made.id = "probe"; document.body.append(made);
      const number = document.querySelector("#bench input[type=number]");
      made.textContent = JSON.stringify([number.value, number.scrollWidth - number.clientWidth]);"""
    page = page_module.page(small_scene(tmp_path), live=True, bench=sliders)
    _, dom = _browsed(re.sub(r"new WebSocket\(.*?\)", "{}", page), tmp_path, probe)
    assert json.loads(re.search(r'<pre id="probe">(.*?)</pre>', dom).group(1)) == ["-1234.567", 0]


@needs_browser
def test_figures_of_an_earlier_command_say_so(tmp_path):
    """Of a command that is refused there are none."""
    probe = """
      const told = () => getComputedStyle($("caption"), "::before").content;
      const bring = answer => socket.onmessage({ data: JSON.stringify(answer) });
      const hear = answer => { bring(answer); return [told(), notice.textContent]; };
      const heard = [hear({ refused: "out of reach" }), hear({ values: {}, film, notice: "there" })];
      const made = document.createElement("pre"); made.id = "probe"; made.textContent = JSON.stringify(heard);
      document.body.append(made);"""
    page = page_module.page(small_scene(tmp_path), live=True, bench=_Doubling().sliders())
    _, dom = _browsed(re.sub(r"new WebSocket\(.*?\)", "{}", page), tmp_path, probe)
    (refused, why), (answered, there) = json.loads(re.search(r'<pre id="probe">(.*?)</pre>', dom).group(1))
    assert (refused, why) == ('"of the last command that was not refused"', "out of reach")
    assert (answered, there) == ("none", "there")


@needs_browser
def test_a_browser_puts_bodies_where_the_solver_has_them(tmp_path):
    scene = film(tmp_path)
    page = write_html(scene, tmp_path / "film.html").read_text()
    probe = """
      const read = k => { go(k); return Array.from(robots[0].groups.get(2).matrix.elements); };
      factor = 1; const found = [0, 1, 2, 3, 1.5].map(read);
      const made = document.createElement("pre"); made.id = "probe"; made.textContent = JSON.stringify(found);
      document.body.append(made);"""
    _, dom = _browsed(page, tmp_path, probe)
    found = json.loads(re.search(r'<pre id="probe">(.*?)</pre>', dom).group(1))
    matrices = np.array(found).reshape(-1, 4, 4).swapaxes(1, 2)
    np.testing.assert_allclose(matrices[:4], scene.robots[0].bodies[:, 2], atol=1e-6)
    between = scene.robots[0].bodies[1:3, 2, :3, 3].mean(axis=0)
    np.testing.assert_allclose(matrices[4][:3, 3], between, atol=1e-6)  # what is played runs smoothly
