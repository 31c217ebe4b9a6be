"""The picture that is made without a screen."""

from dataclasses import replace

import coal
import numpy as np
import pinocchio as pin
import pytest
import trimesh
from PIL import Image

from pouring_robot.exceptions import BadInputError, OutputError
from pouring_robot.viewer import Camera, Scene, SceneArrows, SceneRobot, Step, camera_on, draw, solids, write_png
from pouring_robot.viewer.raycast import Layer, View, edge_mask
from pouring_robot.viewer.shapes import shape_of, visual_model
from tests.viewer.scenes import small_scene

SIZE = (480, 360)


def _pixels(scene, size=SIZE):
    return np.asarray(draw(scene, size)).astype(int)


def _changed(one, other):
    return np.abs(one - other).max(axis=2) > 24


def test_png_has_its_size_and_is_the_same_every_time(tmp_path):
    scene = small_scene(tmp_path)
    first = write_png(scene, tmp_path / "a.png", SIZE)
    second = write_png(scene, tmp_path / "b.png", SIZE)
    assert Image.open(first).size == SIZE
    assert first.read_bytes() == second.read_bytes()
    assert len(np.unique(np.asarray(Image.open(first)).reshape(-1, 3), axis=0)) > 1000


def test_each_part_of_the_scene_changes_the_picture(tmp_path):
    scene = small_scene(tmp_path)
    actual, nominal = scene.robots
    full = _pixels(scene)
    for less in (
        replace(scene, robots=(nominal,)),
        replace(scene, robots=(actual,)),
        replace(scene, arrows=()),
        replace(scene, steps=(Step(),)),
        replace(scene, exaggeration=1.0),
    ):
        # The camera must not move with what is left out.
        assert _changed(full, _pixels(replace(less, camera=camera_on(scene)))).sum() > 20


def test_the_arrow_lies_over_what_hides_it(tmp_path):
    scene = small_scene(tmp_path)
    middle = np.array([1.0, 2.0, 0.05])  # inside the arm
    camera = Camera(middle + np.array([0.2, -2.0, 0.3]), middle)
    inside = SceneArrows("error", (middle - np.array([0.02, 0, 0]))[None, None], np.array([[[0.002, 0.0, 0.0]]]))
    pixels = _pixels(replace(scene, robots=(scene.robots[1],), arrows=(inside,), camera=camera, steps=(Step(),)))
    red = (pixels[..., 0] > 140) & (pixels[..., 1] < 90) & (pixels[..., 2] < 90)
    assert red[:, SIZE[0] // 2 :].sum() > 10


def test_a_label_stays_in_the_picture(tmp_path):
    """At the right edge it stands left of its arrow, as whole as it is in the middle."""
    scene, middle = small_scene(tmp_path, steps=(Step(),)), np.array([1.0, 2.0, 0.05])
    camera = Camera(middle - np.array([0.0, 2.0, 0.0]), middle)  # half of its width is 0.4 m there
    inks = []
    for aside in (0.25, 0.38):
        arrow = SceneArrows(
            "error", (middle + np.array([aside, 0.0, 0.0]))[None, None], np.array([[[0.0, 0.0, 0.002]]])
        )
        shown = _pixels(replace(scene, arrows=(arrow,), camera=camera))
        inks.append(int(_changed(shown, _pixels(replace(scene, arrows=(), camera=camera))).sum()))
    assert inks[1] == pytest.approx(inks[0], rel=0.1)


def test_translucent_bodies_let_the_background_through(tmp_path):
    scene = small_scene(tmp_path, arrows=(), steps=(Step(),))
    nominal = scene.robots[1]
    camera = camera_on(scene)
    empty = _pixels(replace(scene, robots=(replace(nominal, opacity=0.02),), camera=camera))
    faint = _pixels(replace(scene, robots=(replace(nominal, opacity=0.3),), camera=camera))
    solid = _pixels(replace(scene, robots=(replace(nominal, opacity=1.0),), camera=camera))
    weak, strong = np.abs(faint - empty).sum(), np.abs(solid - empty).sum()
    assert 0.1 * strong < weak < 0.7 * strong


def test_rays_meet_the_surface_where_it_is(tmp_path):
    scene = small_scene(tmp_path)
    ball = next(body for body in solids(scene) if body.name.startswith("arm_1") and body.group == "actual")
    centre = ball.pose_world_to_solid[:3, 3]
    camera = Camera(centre + np.array([0.0, -2.0, 0.0]), centre)
    view = View(camera, 201, 101, 80.5)
    hits = Layer([ball], view).meet(view.directions(0, 101))
    np.testing.assert_allclose(view.project(centre[None, :]), [[80.5, 50.5]])
    assert hits.depth[50, 80] == pytest.approx(1.9, abs=1e-3)
    np.testing.assert_allclose(hits.normal[50, 80], (0.0, -1.0, 0.0), atol=2e-2)
    assert not hits.mask[50, 150]
    rows, columns = view.window([ball])
    outside = hits.mask.copy()
    outside[rows, columns] = False
    assert hits.mask[rows, columns].any()
    assert not outside.any()


@pytest.mark.parametrize("scale", ["1 1 1", "1 -1 1", "-2 -1 1", "-1 -1 -3"])
def test_a_mirrored_mesh_shows_its_outside(tmp_path, scale):
    trimesh.creation.cone(radius=0.1, height=0.3).export(tmp_path / "cone.stl")
    mesh = f'<mesh filename="{tmp_path}/cone.stl" scale="{scale}"/>'
    urdf = f'<robot name="r"><link name="a"><visual><geometry>{mesh}</geometry></visual></link></robot>'
    (item,) = visual_model(pin.buildModelFromXML(urdf), urdf).geometryObjects
    shape = shape_of(item)
    corners = shape.vertices[shape.faces]
    assert np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() > 0.0
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.einsum("fi,fci->fc", across, shape.normals[shape.faces]).min() > 0.0


TWO_COLOURS = """<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><created>2026-01-01T00:00:00</created><modified>2026-01-01T00:00:00</modified></asset>
<library_effects><effect id="red"><profile_COMMON><technique sid="t"><phong/></technique></profile_COMMON></effect>
</library_effects><library_materials><material id="a"><instance_effect url="#red"/></material>
<material id="b"><instance_effect url="#red"/></material></library_materials>
<library_geometries><geometry id="g"><mesh><source id="p"><float_array id="f" count="24">
0 0 0 1 0 0 0 1 0 0 0 1  5 0 0 7 0 0 5 2 0 5 0 2</float_array><technique_common>
<accessor source="#f" count="8" stride="3">
<param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common>
</source><vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles material="a" count="4"><input semantic="VERTEX" source="#v" offset="0"/>
<p>0 2 1 0 1 3 0 3 2 1 2 3</p></triangles>
<triangles material="b" count="4"><input semantic="VERTEX" source="#v" offset="0"/>
<p>4 6 5 4 5 7 4 7 6 5 6 7</p></triangles>
</mesh></geometry></library_geometries><library_visual_scenes><visual_scene id="s"><node id="n">
<instance_geometry url="#g">
<bind_material><technique_common><instance_material symbol="a" target="#a"/><instance_material symbol="b" target="#b"/>
</technique_common></bind_material></instance_geometry></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


@pytest.mark.parametrize(("scale", "volume"), [("1 1 1", 1.5), ("2 2 -2", 12.0)])
def test_a_mesh_of_several_colours_is_drawn_whole(tmp_path, scale, volume):
    """Corners of cubes of 1 m and 2 m, each a sixth of its cube, as two materials of one COLLADA geometry."""
    (tmp_path / "two.dae").write_text(TWO_COLOURS, encoding="utf-8")
    mesh = f'<mesh filename="{tmp_path}/two.dae" scale="{scale}"/>'
    urdf = f'<robot name="r"><link name="a"><visual><geometry>{mesh}</geometry></visual></link></robot>'
    (item,) = visual_model(pin.buildModelFromXML(urdf), urdf).geometryObjects
    shape = shape_of(item)
    corners = shape.vertices[shape.faces]
    six_volumes = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum()
    assert six_volumes / 6.0 == pytest.approx(volume)


def test_the_default_camera_shows_the_robots_and_not_all_of_the_truss(tmp_path):
    scene = small_scene(tmp_path)
    view = View(camera_on(scene), 400, 300, 200.0)
    places = {body.link: view.project(body.vertices_in_world()) for body in solids(scene) if body.group == "actual"}
    for link in ("arm", "cup"):
        assert np.all((places[link] > 0.0) & (places[link] < (400.0, 300.0)))


@pytest.mark.parametrize("size", [(10, 900), (1200, 100_000)])
def test_refuses_sizes_out_of_range(tmp_path, size):
    with pytest.raises(BadInputError, match="160 to 6000"):
        draw(small_scene(tmp_path), size)


def test_nothing_is_left_when_the_picture_cannot_be_written(tmp_path):
    with pytest.raises(OutputError, match="is a folder"):
        write_png(small_scene(tmp_path), tmp_path / "small", SIZE)
    assert [path.name for path in tmp_path.iterdir()] == ["small"]


def _boxes(name, boxes, **changes):
    """Return a robot of boxes that stand still: extents and middle of each, in m."""
    visual = pin.GeometryModel()
    for number, (extents, middle) in enumerate(boxes):
        item = pin.GeometryObject(f"{name}_{number}", 0, pin.SE3(np.eye(3), np.array(middle)), coal.Box(*extents))
        item.meshColor = np.array([0.8, 0.7, 0.3, 1.0])
        visual.addGeometryObject(item)
    return SceneRobot(name, visual, np.eye(4)[None, None], **changes)


def test_nothing_hidden_shows_through_what_is_solid():
    wall = _boxes("wall", [((0.1, 2.0, 2.0), (0.5, 0.0, 0.0))])
    behind = _boxes("ghost", [((0.3, 0.3, 0.3), (-0.5, 0.1, 0.0))], opacity=0.4)
    camera = Camera(np.array([6.0, 0.0, 0.2]), np.zeros(3), 15.0)
    alone, both = (_pixels(Scene("wall", robots, camera=camera)) for robots in ((wall,), (wall, behind)))
    rest = slice(SIZE[0] // 2, None)  # beside the panel, whose legend grows
    np.testing.assert_array_equal(alone[:, rest], both[:, rest])


def test_flush_parts_of_one_colour_have_no_line_between_them():
    eye = Camera(np.array([3.0, 0.3, 0.8]), np.zeros(3), 20.0)
    view = View(eye, 300, 200, 150.0)

    def lines(*boxes):
        layer = Layer(solids(Scene("beam", (_boxes("beam", boxes),), camera=eye)), view)
        return edge_mask(layer.meet(view.directions(0, 200)))

    whole = lines(((0.2, 1.0, 0.2), (0.0, 0.0, 0.0)))
    halves = lines(((0.2, 0.6, 0.2), (0.0, -0.2, 0.0)), ((0.2, 0.6, 0.2), (0.0, 0.2, 0.0)))  # they overlap
    np.testing.assert_array_equal(halves, whole)
    stepped = lines(((0.2, 0.6, 0.2), (0.0, -0.2, 0.0)), ((0.2, 0.6, 0.3), (0.0, 0.2, 0.0)))
    assert stepped.sum() > whole.sum() + 20
