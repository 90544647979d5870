"""Parts of a plan that run apart, as tasks of a job array, and their results as one."""

import re
from dataclasses import replace
from pathlib import Path

from pydantic import ValidationError

from imaging.errors import InputError
from imaging.files import store
from rig.batch.batch_plan import BatchPlan
from rig.batch.result import BatchResult, BatchRow


def shard_of(plan: BatchPlan, text: str) -> BatchPlan:
    """Return one of N parts of a plan, with every Nth of its sessions.

    Args:
        plan: all of it.
        text: "i/N", i from 1 to N. Every session is in exactly one of the N parts, as long as all parts
            find the same sessions.

    Raises:
        InputError: the text is not of that form.
    """
    number, _, count = text.partition("/")
    if not (number.isdecimal() and count.isdecimal() and 1 <= int(number) <= int(count)):
        raise InputError(f"--shard {text}: give the part and the number of parts, such as 3/8 (1/8 to 8/8).")
    shard = f"{int(number)}/{int(count)}"
    whole = absolute(plan)
    return replace(whole, sessions=whole.sessions[int(number) - 1 :: int(count)], shard=shard)


def merged(plan: BatchPlan) -> tuple[BatchResult, str | None]:
    """Join what the shards of a plan wrote beside it.

    Returns:
        The rows of all shards in the order of the plan, of which the newest counts where one was made twice,
        and none that was made with other options than the plan has now; and one sentence about the scenes
        that no shard has a row of, or None.

    Raises:
        InputError: no shard has written anything, or a record is damaged.
    """
    plan = absolute(plan)
    # The name of a plan may have the brackets of a pattern, and begin with that of another.
    name = re.compile(rf"{re.escape(plan.path.stem)}\.\d+-of-\d+\.batch\.json")
    written = [one for one in plan.path.parent.glob("*-of-*.batch.json") if name.fullmatch(one.name)]
    records = sorted(written, key=lambda one: one.stat().st_mtime_ns)
    if not records:
        raise InputError(f"Beside {plan.path} no shard has written a result: run rig batch with --shard i/N.")
    words = {scene.called: " ".join(scene.words()) for scene in plan.scenes}
    rows: dict[tuple[Path, str], BatchRow] = {}
    for path in records:
        try:
            result = BatchResult.model_validate(store.read_json(path))
        except ValidationError as error:
            raise InputError(
                f"{path} is damaged: run its shard again, which makes only what is missing."
            ) from error
        rows |= {(row.session, row.scene): row for row in result.rows if row.words == words.get(row.scene)}
    wanted = [(session, scene.called) for session in plan.sessions for scene in plan.scenes]
    missing = [key for key in wanted if key not in rows]
    sentence = None
    if missing:
        session, scene = missing[0]
        sentence = (
            f"{len(missing)} of {len(wanted)} scenes have no result, such as {scene} of {session}: run their "
            "shards again, which make only what is missing."
        )
    return BatchResult(plan=plan.path, rows=tuple(rows[key] for key in wanted if key in rows)), sentence


def absolute(plan: BatchPlan) -> BatchPlan:
    """Return the plan with paths that mean the same in every working folder."""
    return replace(
        plan, path=plan.path.absolute(), sessions=tuple(session.absolute() for session in plan.sessions)
    )
