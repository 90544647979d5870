"""In-camera processing that is switched off, and read back.

Makers say of gamma (Blackfly: "available in all pixel formats"), lookup tables and more that they act on raw
mosaics too, and Basler's ProcessedRawEnable sends a mosaic that is made of a developed picture. Each would
bend or mix the light of every frame without a trace in it. Names are those of SFNC, and of the descriptions
of FLIR, Point Grey, Basler, Allied Vision, Vieworks and Adimec that ADGenICam collects. Gains of single
colours are in drivers/genicam/colours.py.

What stays as it is set, since samples remain proportional to light: the size of frames (windows, binning,
decimation), BlackLevel, DigitalGain and the factory's own corrections of a sensor (DSNU, PRNU, clamping of
black).
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass

from drivers.errors import CameraRefused
from drivers.genicam.nodemap import NodeMap

_OFF = ("off", "disabled", "disable", "false", "none", "linear")
"""Entries that mean that something is off, in small letters, of enumerations that switch it."""
_OFF_OF = {"ExposureMode": ("timed",), "ExposureModeValue": ("timed",)}
"""The same of enumerations whose entries have names of their own."""
_ALIKE = 0.005
"""Relative tolerance of an amount where a camera counts in steps."""


@dataclass(frozen=True)
class Stage:
    """A step of a camera's processing, in words.

    switches: what turns it on and off. amounts: numbers, and the value at which each does nothing.
    selector: has a switch or an amount for each of its entries. A stage is off where a switch of its own
    says so, or where every amount is at the value that does nothing.
    """

    name: str
    switches: tuple[str, ...] = ()
    amounts: tuple[tuple[str, float], ...] = ()
    selector: str | None = None


STAGES = (
    Stage("automatic exposure", ("ExposureAuto",)),
    Stage("automatic gain", ("GainAuto", "GainAutoBalance", "pgrExposureCompensationAuto")),
    Stage("automatic black level", ("BlackLevelAuto", "BlackLevelAutoBalance")),
    Stage("automatic white balance", ("BalanceWhiteAuto",)),
    Stage(
        "image signal processor",
        ("IspEnable", "ISPEnable", "OnBoardColorProcessEnabled", "ProcessedRawEnable", "PgiMode"),
    ),
    Stage("gamma", ("GammaEnable", "GammaEnabled", "GammaMode", "GammaCorrection"), (("Gamma", 1.0),)),
    Stage("lookup table", ("LUTEnable", "LUTEnabled", "LUTConfiguration"), selector="LUTSelector"),
    Stage("white balance", ("BalanceWhiteEnable", "BalanceRatioEnable")),
    Stage(
        "colour transformation",
        (
            *("ColorTransformationEnable", "ColorTransformationMode", "ColorCorrectionEnable"),
            *("LightSourceSelector", "LightSourcePreset", "BslLightSourcePreset"),
        ),
        selector="ColorTransformationSelector",
    ),
    Stage(
        "adjustment of hue and saturation",
        (
            "HueAuto",
            "HueEnabled",
            "SaturationAuto",
            "SaturationEnable",
            "SaturationEnabled",
            "ColorAdjustmentEnable",
        ),
    ),
    Stage("digital shift", amounts=(("DigitalShift", 0.0),)),
    Stage(
        "sharpening",
        (
            *("SharpeningAuto", "SharpnessAuto", "SharpeningEnable", "SharpnessEnabled", "SharpnessEnable"),
            *("EdgeFilter", "MedianFilter"),
        ),
        (("Sharpening", 0.0), ("BslSharpnessEnhancement", 0.0)),
    ),
    Stage(
        "noise reduction",
        ("DenoisingEnable", "NoiseReductionEnable", "FixedPatternNoiseReduction", "LinearFilterControl"),
        (("NoiseReductionAbs", 0.0), ("BslNoiseReduction", 0.0)),
    ),
    Stage("brightness", ("BF_AutoLevelAdjust",), (("BslBrightness", 0.0),)),
    Stage(
        "contrast",
        ("ContrastMode", "BslContrastMode", "ToneMappingEnable", "ImageAdjustMethod"),
        (("BslContrast", 0.0),),
    ),
    Stage("conversion to temperatures", ("TemperatureLinearMode",)),
    Stage(
        "several slopes or exposures in one",
        ("HDR_Mode", "pgrHDRModeEnabled", "MultiSlopeMode", "HDREnable"),
    ),
    Stage("way of ending or repeating exposures", ("ExposureMode", "ExposureModeValue")),
    Stage("mirroring", ("ReverseX", "ReverseY", "HorizontalFlip", "VerticalFlip")),
    Stage(
        "scaling",
        ("ImageScaling",),
        tuple((f"Scaling{way}{kind}", 1.0) for way in ("Horizontal", "Vertical") for kind in ("", "Abs")),
    ),
    Stage(
        "shading correction",
        (
            *("LensShadingCorrectionMode", "LensShadingCorrectionEnable", "VignettingCorrectionMode"),
            *("ShadingCorrectionMode", "ShadingEnable", "FlatFieldCorrection", "FlatFieldCorrectionEnable"),
            "FfcEnable",
        ),
    ),
    Stage(
        "correction of defective pixels",
        (
            *(
                "DefectCorrectStaticEnable",
                "DefectMaskEnable",
                "DefectMaskPixelEnable",
                "DefectMaskColumnEnable",
            ),
            *("DefectPixelCorrection", "DefectPixelCorrectionEnable", "pgrDefectPixelCorrectionEnable"),
            *("HotPixelCorrection", "DynamicDefectivePixelCorrection", "DefectivePixelCorrection"),
            *("VendorDefectPixelCorr", "BslStaticDefectPixelCorrectionMode"),
        ),
    ),
    Stage(
        "test picture",
        ("TestPattern", "TestImageSelector", "IRTestPattern"),
        selector="TestPatternGeneratorSelector",
    ),
    Stage("compression", ("ImageCompressionMode", "AdaptiveCompressionEnable")),
)
_MAY_STAY = frozenset(
    ("correction of defective pixels", "shading correction", "adjustment of hue and saturation")
)
"""Processing that is no reason to refuse a camera that cannot switch it off: it changes few pixels, all by a
fixed factor, or none of a mosaic.
"""


def switch_off(nodes: NodeMap, name: str) -> None:
    """Switch every stage off that the camera has, and read all back. CameraRefused: one stays on.

    name: of the camera, for messages.
    """
    for stage in STAGES:
        for _ in _chosen(nodes, stage):
            # An amount may be locked while its switch is off, so that it goes first.
            for amount, neutral in stage.amounts:
                if nodes.writable(amount) and not _counts_otherwise(nodes, amount, neutral):
                    with suppress(CameraRefused):  # what it then is, is read back
                        nodes.set_nearest(amount, neutral)
            for switch in stage.switches:
                off = _off(nodes, switch)
                if off is not None and nodes.writable(switch):
                    with suppress(CameraRefused):
                        nodes.set(switch, off)
    # Again from the beginning, as one may have switched another on.
    for stage in STAGES:
        for entry in _chosen(nodes, stage):
            on = _still_on(nodes, stage)
            if on and stage.name not in _MAY_STAY:
                raise CameraRefused(
                    f"{name} changes every frame by its {stage.name} and cannot be kept from it "
                    f"({f'{stage.selector} {entry}: ' if entry else ''}{on}): switch it off by its maker's "
                    "program, or take another camera."
                )


def _chosen(nodes: NodeMap, stage: Stage) -> Iterator[str]:
    """Each entry of the stage's selector in turn, chosen; once, as "", where it has none."""
    if stage.selector is None or not nodes.writable(stage.selector):
        yield ""
        return
    for entry in nodes.entries(stage.selector):
        try:
            nodes.set(stage.selector, entry)
        except CameraRefused:  # not one for this format of pixels
            continue
        yield entry


def _off(nodes: NodeMap, switch: str) -> str | bool | None:
    """Return what a switch is set to so that it is off; None where there is no such switch."""
    if not nodes.available(switch):
        return None
    kind = nodes.kind(switch)
    if kind == "Enumeration":
        plain = {entry.removeprefix(f"{switch}_").casefold(): entry for entry in nodes.entries(switch)}
        return next((plain[off] for off in _OFF_OF.get(switch, _OFF) if off in plain), None)
    return False if kind in ("Boolean", "Integer") else None


def _counts_otherwise(nodes: NodeMap, amount: str, neutral: float) -> bool:
    """Return whether a factor is in whole numbers, of which 1 is not the factor 1."""
    return neutral == 1.0 and nodes.kind(amount) == "Integer"


def _still_on(nodes: NodeMap, stage: Stage) -> str:
    """Return what says that a stage is on, as `FEATURE is VALUE`; empty where it is off, or is not there."""
    on, off = "", False
    for switch in stage.switches:
        wanted = _off(nodes, switch)
        if wanted is None:
            continue
        state = nodes.text(switch) if isinstance(wanted, str) else bool(nodes.number(switch))
        off = off or state == wanted
        if state != wanted:
            return f"{switch} is {state}"
    for amount, neutral in stage.amounts:
        if off or not nodes.available(amount):
            continue
        value = float(nodes.number(amount))
        if _counts_otherwise(nodes, amount, neutral):
            on = f"{amount} is {value:g}, in a unit of its own"
        elif abs(value - neutral) > _ALIKE:
            on = f"{amount} is {value:g}"
    return on
