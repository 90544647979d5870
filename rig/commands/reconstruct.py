"""`rig reconstruct`: train a scene."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import typer

from rig.commands.evaluate import run_evaluate
from rig.commands.options import JsonOption, SeedOption, SessionArgument, seconds
from rig.progress import Meter, speaks
from rig.running import Outcome, running
from rig.words import duration

MethodName = Literal["auto", "nh-3dgs", "hdr-gs", "vanilla"]
Quality = Literal["draft", "standard", "best"]


def reconstruct(
    session: SessionArgument,
    method: Annotated[
        MethodName, typer.Option(help="auto chooses by what the session holds: RAW or photographs.")
    ] = "auto",
    quality: Annotated[Quality, typer.Option(help="How long and how fine.")] = "standard",
    budget: Annotated[
        float | None,
        typer.Option(parser=seconds, metavar="TIME", help="Train no longer than this, as 90s or 5m."),
    ] = None,
    seed: SeedOption = 0,
    sets: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Fix one of iterations, gaussians, width, degree, ssim, growth, views, exposures; may be "
            "repeated. rig trade says what each of them buys.",
        ),
    ] = None,
    name: Annotated[
        str | None, typer.Option(help="Folder name under SESSION/reconstructions; the method if not given.")
    ] = None,
    as_json: JsonOption = False,
) -> Outcome:
    """Train a scene on a calibrated session.

    The scene is made of Gaussians, measured on held-out views and reported. A training that was
    stopped goes on when the same command is run again. Runs on the GPU if there is one. With several
    GPUs or machines, `torchrun ... -m rig reconstruct S` trains on all of them together.

    Example: rig reconstruct S --budget 5m
    """
    with running("reconstruct") as meter:
        return run_reconstruct(
            session, meter, method=method, quality=quality, budget=budget, seed=seed, name=name, sets=sets
        )


def run_reconstruct(
    session: Path,
    meter: Meter,
    *,
    method: MethodName,
    quality: Quality,
    budget: float | None,
    seed: int,
    name: str | None,
    sets: Sequence[str] | None = None,
) -> Outcome:
    """Train, evaluate, write the report and say what came of it."""
    trained = run_training(
        session, meter, method=method, quality=quality, budget=budget, seed=seed, name=name, sets=sets
    )
    if not speaks():
        return Outcome({}, [])
    evaluated = run_evaluate(Path(trained.data["reconstruction"]), meter)
    return replace(evaluated, lines=[*trained.lines, *evaluated.lines])


def run_training(
    session: Path,
    meter: Meter,
    *,
    method: MethodName,
    quality: Quality = "standard",
    budget: float | None = None,
    seed: int = 0,
    name: str | None = None,
    sets: Sequence[str] | None = None,
) -> Outcome:
    """Train a scene, or go on with it."""
    from recon.fixed import Fixed

    fixed = Fixed.of(sets or ())
    from recon.model import read_model
    from recon.reconstruct import reconstruct as reconstruct_session

    folder = reconstruct_session(
        session,
        method=method,
        quality=quality,
        budget=budget,
        seed=seed,
        fixed=fixed,
        name=name,
        progress=meter,
    )
    if not speaks():
        return Outcome({"reconstruction": str(folder)})
    record = read_model(folder)
    line = f"{folder}: trained in {duration(record.train_seconds)} on {record.device}"
    return Outcome({"reconstruction": str(folder), "device": record.device}, [line])
