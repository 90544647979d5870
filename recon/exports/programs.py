"""Programs that files are written for: the format of each, its light, and how far that was tried."""

from dataclasses import dataclass

from recon.exports.request import FormatName, ProgramName


@dataclass(frozen=True)
class Program:
    """Program that opens a format: whether its light is linear (None: the format's default), how to open it
    there, and how far the file was tried.
    """

    format: FormatName
    linear: bool | None
    opens: str
    tried: str

    def __str__(self) -> str:
        return f"{self.opens}; {self.tried}"


READ = "no picture of it: other programs read the numbers of the file"
PROGRAMS: dict[ProgramName, Program] = {
    "nuke": Program("usd", None, "Nuke 17 or later, GeoImport, y up", READ),
    "houdini": Program("usd", None, "a stage of Solaris, y up", READ),
    "blender": Program(
        "usd",
        None,
        "its importer takes the cameras, y up turned to z up; splats need an add-on",
        "cameras of Blender 5.0 agree (docs/export.md); it draws no splats without the add-on",
    ),
    "arnold": Program("ply", True, "its Gaussian shape, colours as linear Rec.709, y down", READ),
    "realitykit": Program(
        "ply", True, "GaussianSplatResource with colorSpace extendedLinearSRGB, y down", READ
    ),
    "unreal": Program("ply", False, "binary PLY, drawn before its tone map, y down", READ),
    "supersplat": Program(
        "sog",
        None,
        "sRGB codes, which its tone maps decode",
        "pictures of PlayCanvas 2.23, of which it is made, agree (docs/export.md)",
    ),
    "spark": Program("ply", False, "a SplatMesh, y down", "pictures of Spark 2.2 agree (docs/export.md)"),
    "three": Program(
        "ply",
        False,
        "a SplatMesh of Spark, or a GaussianSplat with outputColorSpace = LinearSRGBColorSpace, y down",
        "pictures of Spark 2.2 agree, those of three.js 0.187 less (docs/export.md)",
    ),
    "babylon": Program(
        "ply",
        False,
        "ImportMeshAsync in a right-handed scene, y down once the mesh has a scaling of 1 and no rotation",
        "pictures of Babylon.js 9.28 agree (docs/export.md)",
    ),
}
