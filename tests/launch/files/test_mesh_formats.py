"""Readers of mesh formats: the surface that was written, and refusal of what is damaged."""

import numpy as np
import pytest

from palpate.core.geometry import solidity
from palpate.launch.files.mesh_file import READERS
from tests.launch.files.samples import FACES, GLTF, HELD, MESHES, VERTICES, glb


@pytest.mark.parametrize("name", MESHES)
def test_every_format_gives_the_surface_that_was_written(name):
    mesh = READERS[name.rpartition(".")[2]](MESHES[name])
    assert (mesh.vertices.dtype, mesh.faces.dtype) == (np.float64, np.int64)
    raised = np.array([0.0, 0.0, 50.0]) if name.endswith("glb") else np.zeros(3)
    corners = mesh.vertices[mesh.faces] - raised
    if name == "mixed.ply":  # its quadrilateral may be cut along the other diagonal
        assert len(mesh.faces) == len(FACES)
        assert solidity(*mesh[:2]).volume == pytest.approx(
            solidity(VERTICES, FACES).volume, rel=0.01
        )
    else:  # coordinates are rounded to 1e-4 mm, or to single precision
        assert corners == pytest.approx(VERTICES[FACES], abs=1e-4)


TETRAHEDRON = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"


@pytest.mark.parametrize(("text", "faces"), [
    (b"f 1 2 3\n", [[0, 1, 2]]),
    (b"f 1/5 2/6/7 3//8\n", [[0, 1, 2]]),
    (b"f -4 -3 -2\n", [[0, 1, 2]]),
    (b"f 1 2 3 4\n", [[0, 1, 2], [0, 2, 3]]),
    (b"f 1 2 \\\n3 # a comment\n", [[0, 1, 2]]),
    (b"o one\nf 1 2 3\no other\nusemtl red\nf 1 3 4\n", [[0, 1, 2], [0, 2, 3]]),
])  # fmt: skip
def test_obj_indices_count_from_one_or_backwards(text, faces):
    assert READERS["obj"](TETRAHEDRON + text).faces.tolist() == faces


def test_colours_and_line_ends_are_ignored():
    obj = READERS["obj"](b"v 0 0 0 1 0 0\r\nv 1 0 0 0.5 0 0\r\nv 0 1 0 1 1 1\r\nf 1 2 3\r\n")
    text = b"COFF 3 1 0\n0 0 0 255 0 0 255\n1 0 0 0 0 0 0\n0 1 0 0 0 0 0\n3 0 1 2 9\n"
    off = READERS["off"](text)
    for mesh in (obj, off):
        np.testing.assert_array_equal(mesh.vertices, [[0, 0, 0], [1, 0, 0], [0, 1, 0]])
        assert mesh.faces.tolist() == [[0, 1, 2]]


def test_glb_nodes_transform_repeat_and_mirror_their_mesh():
    turn = {"children": [1], "rotation": [0.0, 0.0, 0.5**0.5, 0.5**0.5], "scale": [2.0, 2.0, 2.0]}
    place = np.eye(4)
    place[:3, 3] = [100.0, 0.0, 0.0]
    moved = {"mesh": 0, "matrix": place.T.ravel().tolist()}
    unread = {"byteLength": 4, "uri": "textures.bin"}
    mesh = READERS["glb"](changed(nodes=[turn, moved], buffers=[*GLTF["buffers"], unread]))
    # First 100 mm along x, then twice as large and turned about z, from x to y.
    np.testing.assert_allclose(mesh.vertices.mean(axis=0), [0.0, 200.0, 0.0], atol=1e-3)
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), [100.0, 120.0, 160.0], rtol=1e-2)
    mirrored = {"mesh": 0, "translation": [200.0, 0.0, 0.0], "scale": [-1.0, 1.0, 1.0]}
    nodes = [{"mesh": 0}, mirrored, {"mesh": 0, "translation": [9e9, 0.0, 0.0]}]
    single = READERS["glb"](MESHES["plain.glb"])
    data = changed(nodes=nodes, scenes=[{"nodes": [2]}, {"nodes": [0, 1]}], scene=1)
    mesh = READERS["glb"](data + b"\n")
    assert solidity(*mesh[:2]).volume == pytest.approx(2.0 * solidity(*single[:2]).volume)
    assert mesh.notes == ("2 pieces put together", "1 byte after its end ignored")


@pytest.mark.parametrize(("mode", "corners"), [(5, [0, 1, 2, 3]), (6, [0, 1, 3, 2])])
def test_strips_and_fans_become_triangles_of_one_orientation(mode, corners):
    places = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], "<f4")[corners]
    described = {
        "asset": {"version": "2.0"},
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": mode}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 4}],
        "bufferViews": [{"buffer": 0, "byteLength": 48}],
        "buffers": [{"byteLength": 48}],
    }
    mesh = READERS["glb"](glb(described, places.tobytes()))
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    np.testing.assert_allclose(np.cross(b - a, c - a)[:, 2], [1.0, 1.0])


TEXT_STL = MESHES["text.stl"]
NAME = TEXT_STL.split(b"\n")[0].removeprefix(b"solid").strip()


@pytest.mark.parametrize(("kind", "data"), [
    ("stl", b"\xef\xbb\xbf" + TEXT_STL),
    ("stl", TEXT_STL.replace(b"\n", b"\r")),
    ("stl", b" ".join(TEXT_STL.split())),
    ("stl", TEXT_STL.replace(b"endsolid", b"end solid") + b"\n\n"),
    ("stl", TEXT_STL.replace(b"solid " + NAME, b"solid endsolid facet normal vertex 1 2 3")),
    ("stl", b"solid".ljust(80) + MESHES["binary.stl"][80:] + b"\n"),
    ("obj", b"\xef\xbb\xbf" + MESHES["plain.obj"]),
    ("off", b"# a comment\n" + MESHES["plain.off"]),
    ("off", b" ".join(MESHES["plain.off"].replace(b"# by hand", b"").split())),
    ("ply", MESHES["text.ply"].replace(b"\n", b"\r")),
    ("ply", MESHES["big.ply"] + b"\r\n"),
    ("ply", MESHES["text.ply"].replace(b"element", b"comment end_header here\nelement", 1)),
])  # fmt: skip
def test_odd_names_marks_and_tails_change_nothing(kind, data):
    plain = {"stl": "text.stl", "ply": "text.ply", "obj": "plain.obj", "off": "plain.off"}[kind]
    found, expected = READERS[kind](data), READERS[kind](MESHES[plain])
    corners = [one.vertices[one.faces] for one in (found, expected)]
    assert corners[0] == pytest.approx(corners[1], abs=1e-4)


def changed(**parts):
    return glb({**GLTF, **parts}, HELD)


def ply(old, new, name="text.ply"):
    data = MESHES[name]
    assert old in data
    return data.replace(old, new, 1)


def stl(old, new):
    return MESHES["text.stl"].replace(old, new, 1)


@pytest.mark.parametrize(("kind", "data", "words"), [
    ("glb", lambda: changed(nodes=[{"mesh": 0, "rotation": [0.0, 0.0, 2.0, 0.0]}]),
     "has a node whose rotation has the length 2, not 1"),
    ("ply", lambda: b"ply\n" + b"comment x\n" * 9999,
     "a header without an end, or of more than 64"),
    ("ply", lambda: ply(b"vertex 162", b"vertex -162"), "states '-162' as a count"),
    ("ply", lambda: ply(b"vertex 162", b"vertex 9999999"), "states 9999999 vertices"),
    ("ply", lambda: ply(b"face 320", b"face 2000000000"), "states 2000000000 faces"),
    ("ply", lambda: ply(b"face 320", b"face 321"), "it lacks some of 321 rows of 'face'"),
    ("ply", lambda: MESHES["little.ply"][:900], "is cut short"),
    ("ply", lambda: MESHES["mixed.ply"][:-2], "is cut short"),
    ("ply", lambda: ply(b"face 320", b"face 319"), "has more in it than its header states"),
    ("ply", lambda: ply(b"face 320", b"face 321", "big.ply"), "is cut short"),
    ("ply", lambda: ply(b"float z", b"float w"), "has vertices without z"),
    ("ply", lambda: ply(b"float z", b"float y"), "the property 'y' twice"),
    ("ply", lambda: ply(b"float z", b"text z"), "the property 'text z' in its header"),
    ("ply", lambda: ply(b"uchar int", b"float int"), "whose length is no whole number"),
    ("ply", lambda: ply(b"vertex_indices", b"corners"), "faces without a list 'vertex_indices'"),
    ("ply", lambda: ply(b"element", b"elephant"), "the line 'elephant vertex 162' in its header"),
    ("ply", lambda: ply(b"format ascii 1.0\n", b""), "does not state its format"),
    ("ply", lambda: ply(b"\n3 ", b"\n2000000000 "), "a list 'vertex_indices' of 2e"),
    ("ply", lambda: ply(b"\n3 ", b"\n-3 "), "a list 'vertex_indices' of -3 items"),
    ("ply", lambda: ply(b"\n3 ", b"\n3 0.5"), "a corner that is no whole number"),
    ("ply", lambda: ply(b"\n3 ", b"\nthree "), "something else where there must be numbers"),
    ("stl", lambda: b"\0" * 83, "is cut short"),
    ("stl", lambda: MESHES["binary.stl"][:-1], "cut short: it states 320 triangles and has 319"),
    ("stl", lambda: MESHES["binary.stl"] + b"x" * 50, "states 320 triangles and has 321"),
    ("stl", lambda: stl(b"endsolid", b""), "its last solid has no end"),
    ("stl", lambda: stl(b"vertex", b"vortex"), "has 959 corners in 320 facets"),
    ("stl", lambda: stl(b"vertex", b"vertex 1"), "a corner that is not three numbers"),
    ("obj", lambda: TETRAHEDRON + b"f 1 2\n", "a face of 2 corners"),
    ("obj", lambda: TETRAHEDRON + b"f 1 2 x\n", "a face with the corner 'x'"),
    ("obj", lambda: TETRAHEDRON + b"f 1 2 " + b"9" * 5000,
     "a face with the corner '99999999999999999999'"),
    ("obj", lambda: TETRAHEDRON + b"f " + b"1 2 3 4 " * 500,
     "a face of 2000 corners; at most 1024"),
    ("obj", lambda: b"v 1 2\n", "a vertex that is not three numbers"),
    ("off", lambda: b"OFF", "does not state how many"),
    ("off", lambda: b"OFF\n-1 1 0\n", "states -1 vertices"),
    ("off", lambda: b"OFF\n4 4 0\n0 0 0\n", "states 4 vertices and 4 faces, and has 1 lines"),
    ("off", lambda: b"OFF\n1 1 0\n0 0 0\n9 0 0 0\n", "a face without the corners that it states"),
    ("off", lambda: b"mesh", "does not begin with OFF"),
    ("glb", lambda: b"glTF", "is cut short"),
    ("glb", lambda: b"glTF" + b"\1\0\0\0" * 4, "does not begin as glTF 2 does"),
    ("glb", lambda: MESHES["plain.glb"][:-4], "is cut short"),
    ("glb", lambda: glb(b"[" * 100_000, b""), "is described by something else than glTF"),
    ("glb", lambda: changed(meshes=[], nodes=[]), "shows no triangles"),
    ("glb", lambda: changed(buffers=[{"uri": "x.bin"}]), "keeps its data elsewhere, in 'x.bin'"),
    ("glb", lambda: changed(extensionsRequired=["KHR_draco_mesh_compression"]),
     "is compressed with KHR_draco_mesh_compression, which is not read"),
    ("glb", lambda: changed(extensionsRequired=["EXT_odd"]), "needs the extension EXT_odd, which"),
    ("glb", lambda: changed(bufferViews=[]), "names a part that does not exist"),
    ("glb", lambda: changed(nodes=[{"children": [0], "mesh": 0}]), "within itself"),
    ("glb", lambda: changed(nodes=[{"children": [1, 1]}, {"mesh": 0}]), "within two others"),
    ("glb", lambda: changed(nodes=[{"mesh": 0, "matrix": [1.0]}]), "a matrix of 1 numbers"),
])  # fmt: skip
def test_damaged_file_is_refused_in_one_sentence(kind, data, words):
    with pytest.raises(ValueError, match=r"^[a-z]") as caught:
        READERS[kind](data())
    assert words in str(caught.value)
    assert len(str(caught.value)) < 200


@pytest.mark.parametrize(("key", "value", "words"), [
    ("count", 10**9, "states 1000000000 numbers that it does not hold"),
    ("count", -1, "states -1 numbers"),
    ("byteOffset", -4, "numbers that it does not hold"),
    ("byteOffset", 10**12, "numbers that it does not hold"),
    ("componentType", 5130, "numbers of a kind that is not read"),
    ("type", "MAT4", "numbers of a kind that is not read"),
    ("sparse", {"count": 1}, "numbers of a kind that is not read"),
    ("bufferView", None, "names a part that does not exist"),
    ("count", "many", "is described by something else than glTF"),
])  # fmt: skip
def test_glb_accessor_beyond_its_data_is_refused(key, value, words):
    first, second = GLTF["accessors"]
    for accessors in ([{**first, key: value}, second], [first, {**second, key: value}]):
        with pytest.raises(ValueError, match=words):
            READERS["glb"](changed(accessors=accessors))
