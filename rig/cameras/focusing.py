"""The plan of focus and views of a rig, in words and as numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from capture.rigfile.focus_plan import FocusPlan, focus_plan
from capture.rigfile.tables import RigTables
from drivers.camera import Capabilities
from imaging.optics.exposure import Exposure

Plans = dict[str, FocusPlan | str]
"""Plan of each camera, or the reason that it has none."""


def focus_plans(tables: RigTables, able: Mapping[str, Capabilities], exposure: Exposure | None) -> Plans:
    """Plan focus and views of each camera of a rig file; empty where the file states no subject."""
    if tables.subject is None:
        return {}
    distances = tables.subject.nearest, tables.subject.farthest
    f_number = None if exposure is None else exposure.f_number
    plans: Plans = {}
    for camera in tables.camera:
        can = able[camera.name]
        if camera.focal_length is None or camera.pixel_pitch is None:
            plans[camera.name] = "its focal_length (mm) and pixel_pitch (um) are not in the file: add them."
        elif not can.width:
            plans[camera.name] = "it does not state the width of its pictures."
        else:
            lens = camera.focal_length, camera.pixel_pitch
            plan = focus_plan(lens, can.width, distances, f_number, can.f_numbers)
            plans[camera.name] = plan or "the nearest of the subject is within its focal length: step back."
    return plans


def focus_lines(plans: Plans, has_file: bool) -> list[str]:
    """Words for the plans; cameras of one plan share their lines. has_file: a rig file could plan more."""
    if not plans:
        hint = " State [subject] and the lenses in the rig file, and focus and views are planned, too."
        stays = "  Focus stays as the lenses are set: one focus for all exposures and views."
        return [stays + hint * has_file]
    groups: dict[FocusPlan | str, list[str]] = {}
    for name, plan in plans.items():
        groups.setdefault(plan, []).append(name)
    lines = []
    for plan, names in groups.items():
        who = ", ".join(names)
        if isinstance(plan, str):
            lines.append(f"  Focus of {who} is not planned: {plan}")
            continue
        lines.append(f"  Focus {who} at {plan.focus:.3g} m. {_sharpness(plan)}")
        lines.append(f"  {_views(plan)}")
    return lines


def _sharpness(plan: FocusPlan) -> str:
    best = f"{plan.advised_blur:.2g} px, sharp in pictures up to {plan.advised_width:,} px wide"
    if plan.f_number is None or plan.blur is None:
        return f"Set f/{plan.advised:g}: it blurs the nearest and the farthest by {best}."
    now = (
        f"f/{plan.f_number:g} blurs the nearest and the farthest by {plan.blur:.2g} px, sharp in pictures up "
        f"to {plan.sharp_width:,} px wide"
    )
    return f"{now}." if plan.f_number == plan.advised else f"{now}; f/{plan.advised:g} by {best}."


def _views(plan: FocusPlan) -> str:
    around = "" if plan.around is None else f"; {plan.around} go all the way round"
    return (
        f"Views: {plan.sees:.2g} m wide at the nearest. Neighbours overlap by two thirds, from at most 30 "
        f"degrees apart, if positions are at most {plan.step:.2g} m apart{around}."
    )


def focus_data(plans: Plans) -> dict[str, Any]:
    """The same as numbers; a string: why a camera has none."""
    return {name: plan if isinstance(plan, str) else asdict(plan) for name, plan in plans.items()}
