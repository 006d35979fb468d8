"""STEP: units, names and kinds of faces; what is no STEP."""

from __future__ import annotations

import builtins
import re
from itertools import count
from pathlib import Path

import numpy as np
import pytest

from lenscal.errors import FileError, GeometryError, UnitError
from planning.scene import Scene
from planning.target import Target

PLATE = Path(__file__).parents[2] / "data/plate.step"

#: How a STEP file states its unit of length.
LENGTH_UNITS = {
    "mm": "( LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.) )",
    "m": "( LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT($,.METRE.) )",
    "in": "( CONVERSION_BASED_UNIT('INCH',#{measure}) LENGTH_UNIT() NAMED_UNIT(#{dimensions}) )",
}


class StepWriter:
    """Collects entities and numbers them."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._numbers = count(1)

    def add(self, text: str) -> str:
        number = f"#{next(self._numbers)}"
        self.lines.append(f"{number} = {text};")
        return number

    def point(self, xyz) -> str:
        return self.add(f"CARTESIAN_POINT('',({','.join(f'{float(v)!r}' for v in xyz)}))")

    def direction(self, xyz) -> str:
        return self.add(f"DIRECTION('',({','.join(f'{float(v)!r}' for v in xyz)}))")

    def axes(self, origin, z, x) -> str:
        parts = f"{self.point(origin)},{self.direction(z)},{self.direction(x)}"
        return self.add(f"AXIS2_PLACEMENT_3D('',{parts})")

    def vertex(self, xyz) -> str:
        return self.add(f"VERTEX_POINT('',{self.point(xyz)})")

    def loop(self, edges) -> str:
        turned = [self.add(f"ORIENTED_EDGE('',*,*,{e},.{'T' if s else 'F'}.)") for e, s in edges]
        return self.add(f"EDGE_LOOP('',({','.join(turned)}))")

    def face(self, name: str, surface: str, outer, inner=(), same_sense: bool = True) -> str:
        bounds = [self.add(f"FACE_OUTER_BOUND('',{self.loop(outer)},.T.)")]
        bounds += [self.add(f"FACE_BOUND('',{self.loop(edges)},.T.)") for edges in inner]
        sense = "T" if same_sense else "F"
        return self.add(f"ADVANCED_FACE('{name}',({','.join(bounds)}),{surface},.{sense}.)")


def write_plate(path: Path, unit: str = "mm", size=(40.0, 30.0, 5.0), radius: float = 6.0) -> None:
    """A plate about the z axis, its top at z = 0; lengths in the unit that the file states."""
    writer = StepWriter()
    x, y, z = size[0] / 2, size[1] / 2, size[2]
    corners = [
        (sx * x, sy * y, level)
        for level in (-z, 0.0)
        for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    vertices = [writer.vertex(c) for c in corners]

    def line(i: int, j: int) -> str:
        step = [b - a for a, b in zip(corners[i], corners[j], strict=True)]
        length = sum(abs(s) for s in step)
        vector = writer.add(f"VECTOR('',{writer.direction([s / length for s in step])},1.0)")
        curve = writer.add(f"LINE('',{writer.point(corners[i])},{vector})")
        return writer.add(f"EDGE_CURVE('',{vertices[i]},{vertices[j]},{curve},.T.)")

    def circle(level: float) -> str:
        start = writer.vertex((radius, 0, level))
        curve = writer.add(
            f"CIRCLE('',{writer.axes((0, 0, level), (0, 0, 1), (1, 0, 0))},{radius!r})"
        )
        return writer.add(f"EDGE_CURVE('',{start},{start},{curve},.T.)")

    low = [line(k, (k + 1) % 4) for k in range(4)]
    high = [line(4 + k, 4 + (k + 1) % 4) for k in range(4)]
    posts = [line(k, 4 + k) for k in range(4)]
    rim_low, rim_high = circle(-z), circle(0.0)

    def plane(origin, normal, along) -> str:
        return writer.add(f"PLANE('',{writer.axes(origin, normal, along)})")

    faces = [
        writer.face(
            "top",
            plane((0, 0, 0), (0, 0, 1), (1, 0, 0)),
            [(e, True) for e in high],
            [[(rim_high, False)]],
        ),
        writer.face(
            "bottom",
            plane((0, 0, -z), (0, 0, -1), (1, 0, 0)),
            [(e, False) for e in reversed(low)],
            [[(rim_low, True)]],
        ),
    ]
    outward = ((0, -1, 0), (1, 0, 0), (0, 1, 0), (-1, 0, 0))
    for k, (name, normal) in enumerate(
        zip(("front", "right", "back", "left"), outward, strict=True)
    ):
        after = (k + 1) % 4
        around = [(low[k], True), (posts[after], True), (high[k], False), (posts[k], False)]
        faces.append(
            writer.face(name, plane(corners[k], normal, (normal[1], -normal[0], 0)), around)
        )
    seam_vector = writer.add(f"VECTOR('',{writer.direction((0, 0, 1))},1.0)")
    seam_line = writer.add(f"LINE('',{writer.point((radius, 0, -z))},{seam_vector})")
    ends = [
        next(line for line in writer.lines if line.startswith(f"{rim} "))
        .split("'',")[1]
        .split(",")[0]
        for rim in (rim_low, rim_high)
    ]
    seam = writer.add(f"EDGE_CURVE('',{ends[0]},{ends[1]},{seam_line},.T.)")
    barrel = writer.add(
        f"CYLINDRICAL_SURFACE('',{writer.axes((0, 0, -z), (0, 0, 1), (1, 0, 0))},{radius!r})"
    )
    around = [(rim_low, False), (seam, True), (rim_high, True), (seam, False)]
    faces.append(writer.face("bore", barrel, around, same_sense=False))
    shell = writer.add(f"CLOSED_SHELL('',({','.join(faces)}))")
    solid = writer.add(f"MANIFOLD_SOLID_BREP('plate',{shell})")
    _product(writer, solid, unit)
    head = (
        "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\n"
        "FILE_NAME('plate.step','2026-01-01',(''),(''),'','','');\n"
        "FILE_SCHEMA(('AUTOMOTIVE_DESIGN { 1 0 10303 214 1 1 1 1 }'));\nENDSEC;\nDATA;\n"
    )
    path.write_text(head + "\n".join(writer.lines) + "\nENDSEC;\nEND-ISO-10303-21;\n", "ascii")


def _product(writer: StepWriter, solid: str, unit: str) -> None:
    application = writer.add("APPLICATION_CONTEXT('automotive design')")
    context = writer.add(f"PRODUCT_CONTEXT('',{application},'mechanical')")
    product = writer.add(f"PRODUCT('plate','plate','',({context}))")
    version = writer.add(f"PRODUCT_DEFINITION_FORMATION('','',{product})")
    stage = writer.add(f"PRODUCT_DEFINITION_CONTEXT('part definition',{application},'design')")
    definition = writer.add(f"PRODUCT_DEFINITION('design','',{version},{stage})")
    shape = writer.add(f"PRODUCT_DEFINITION_SHAPE('','',{definition})")
    stated = LENGTH_UNITS[unit]
    if unit == "in":
        millimetre = writer.add(LENGTH_UNITS["mm"])
        measure = writer.add(f"LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),{millimetre})")
        dimensions = writer.add("DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.)")
        stated = stated.format(measure=measure[1:], dimensions=dimensions[1:])
    length = writer.add(stated)
    angle = writer.add("( NAMED_UNIT(*) PLANE_ANGLE_UNIT() SI_UNIT($,.RADIAN.) )")
    solid_angle = writer.add("( NAMED_UNIT(*) SI_UNIT($,.STERADIAN.) SOLID_ANGLE_UNIT() )")
    uncertainty = writer.add(
        f"UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-07),{length},'accuracy','')"
    )
    units = writer.add(
        "( GEOMETRIC_REPRESENTATION_CONTEXT(3) "
        f"GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT(({uncertainty})) "
        f"GLOBAL_UNIT_ASSIGNED_CONTEXT(({length},{angle},{solid_angle})) "
        "REPRESENTATION_CONTEXT('','') )"
    )
    origin = writer.axes((0, 0, 0), (0, 0, 1), (1, 0, 0))
    brep = writer.add(f"ADVANCED_BREP_SHAPE_REPRESENTATION('',({origin},{solid}),{units})")
    writer.add(f"SHAPE_DEFINITION_REPRESENTATION({shape},{brep})")


def test_the_committed_plate_is_what_this_writes(tmp_path) -> None:
    write_plate(tmp_path / "plate.step")
    assert (tmp_path / "plate.step").read_text() == PLATE.read_text()


def test_reads_a_plate_with_its_faces() -> None:
    scene = Scene.load(PLATE)
    assert scene.names == ("plate",)
    body = scene.bodies[0]
    # Single precision, which the reader hands over, would be off by 4e-7 mm.
    np.testing.assert_allclose(body.bounds_mm, [[-20, -15, -5], [20, 15, 0]], atol=1e-13)
    assert body.cad.names == ("top", "bottom", "front", "right", "back", "left", "bore")
    assert body.cad.kinds == ("plane",) * 6 + ("cylinder",)
    # The chords of the bore lie within the tolerance inside of its circle.
    excess = body.volume_mm3 - 5 * (1200 - 36 * np.pi)
    assert 0 < excess < 0.01 * 5 * 12 * np.pi
    (source,) = scene.sources
    assert (source.unit, source.chord_tolerance_mm) == ("mm", 0.01)


@pytest.mark.parametrize(("unit", "in_mm"), [("mm", 1.0), ("in", 25.4), ("m", 1000.0)])
def test_takes_the_unit_from_the_file(tmp_path, unit: str, in_mm: float) -> None:
    path = tmp_path / "plate.step"
    write_plate(path, unit, (40 / in_mm, 30 / in_mm, 5 / in_mm), 6 / in_mm)
    for stated in (None, unit):
        scene = Scene.load(path, stated)
        np.testing.assert_allclose(np.ptp(scene.bounds_mm, axis=0), [40, 30, 5], rtol=1e-6)
        assert scene.sources[0].unit == unit
    with pytest.raises(UnitError, match=rf"states its lengths in {unit}, but ft is given; leave"):
        Scene.load(path, "ft")


def test_chords_are_as_fine_as_asked() -> None:
    coarse, fine = (
        Scene.load(PLATE, chord_tolerance_mm=t).bodies[0].faces.shape[0] for t in (0.1, 0.001)
    )
    assert fine > 2 * coarse


@pytest.mark.parametrize(
    ("face", "area", "normal"), [("top", 1200 - 36 * np.pi, 2), (3, 150, 0), ("right", 150, 0)]
)
def test_picks_faces_by_name_and_number(face, area: float, normal: int) -> None:
    target = Target.from_face(Scene.load(PLATE), face=face)
    assert target.area_mm2 == pytest.approx(area, rel=1e-3)
    assert target.normal[normal] == pytest.approx(1)


def test_a_point_picks_the_whole_cad_face() -> None:
    assert len(Target.from_face(Scene.load(PLATE), near=(15, 0, 1)).loops) == 2


def test_refuses_faces_that_are_curved_or_not_there() -> None:
    scene = Scene.load(PLATE)
    with pytest.raises(GeometryError, match="face 6 'bore' of plate is no plane but a cylinder"):
        Target.from_face(scene, face="bore")
    with pytest.raises(GeometryError, match=r"'bore' of plate nearest to \(6, 0, -2\) mm is no pl"):
        Target.from_face(scene, near=(6, 0, -2))
    with pytest.raises(
        GeometryError, match="there is no face 'lid'; flat faces are plate: top, pl"
    ):
        Target.from_face(scene, face="lid")
    both = scene.joined(Scene(scene.meshes, ["second"]))
    with pytest.raises(GeometryError, match=r"2 faces are called 'top' \(plate: 0, second: 0\)"):
        Target.from_face(both, face="top")
    assert Target.from_face(both, face="top", body="second").normal[2] == 1


def test_refuses_what_is_no_step(tmp_path) -> None:
    path = tmp_path / "part.step"
    path.write_text("solid ball")
    with pytest.raises(FileError, match="part.step is no STEP file: it does not begin with ISO"):
        Scene.load(path)
    text = PLATE.read_text()
    path.write_text(text[: len(text) // 2])
    with pytest.raises(FileError, match="part.step is cut short: END-ISO-10303-21 is missing"):
        Scene.load(path)
    path.write_text(text.replace("GLOBAL_UNIT", "GLOBAL_NUT"))
    with pytest.raises(UnitError, match="must state one unit of length, but states none"):
        Scene.load(path)
    path.write_text(text.replace(".MILLI.", ".MEGA."))
    with pytest.raises(UnitError, match="unknown unit of length 'MEGA metre'"):
        Scene.load(path)
    path.write_text(re.sub(r"#\d+ = ADVANCED_BREP.*;", "", text))
    with pytest.raises(FileError, match="part.step cannot be read as STEP|part.step holds no body"):
        Scene.load(path)


def test_says_how_to_get_the_reader(monkeypatch) -> None:
    importer = builtins.__import__

    def without_cascadio(name, *arguments, **named):
        if name == "cascadio":
            raise ImportError(name)
        return importer(name, *arguments, **named)

    monkeypatch.setattr(builtins, "__import__", without_cascadio)
    with pytest.raises(FileError, match=r"STEP needs cascadio; install it with pip install 'lens"):
        Scene.load(PLATE)
