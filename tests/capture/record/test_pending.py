"""Which shots a call of `record` takes."""

from capture.record.recorder import record
from tests.capture.check.index_lines import lines, write


def test_a_shot_beyond_the_plan_does_not_stand_for_one_that_is_missing(rig) -> None:
    records = lines(rig.session)
    missing = records[0]["file"]
    records[0]["step"] = 9
    write(rig.session, records)
    result = record(rig.session, rig.plan, rig.cameras, move_to=rig.move_to)
    assert (result.earlier, result.missing) == (17, ())
    assert len(lines(rig.session)) == 19
    assert lines(rig.session)[-1]["file"] == missing
