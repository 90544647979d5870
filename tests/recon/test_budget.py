"""What a budget may be, what is refused, and what is foretold of one."""

import pytest
import torch

from imaging.errors import InputError
from recon.appearance import LuminanceChromaticity
from recon.budget import Budget
from recon.gaussians import Gaussians
from recon.model import Prediction
from recon.ply import most_gaussians, read_ply, write_ply
from recon.prediction import predicted
from recon.probe import Probe


@pytest.fixture
def toy_scene():
    """Three Gaussians and their appearance."""
    appearance = LuminanceChromaticity()
    colours = torch.tensor([[0.1, 0.2, 0.3], [1.0, 0.5, 0.2], [4.0, 4.0, 4.0]])
    geometry = {
        "means": torch.zeros(3, 3),
        "log_scales": torch.zeros(3, 3),
        "quats": torch.ones(3, 4),
        "opacity_logits": torch.zeros(3),
    }
    return Gaussians(geometry | appearance.start(colours)), appearance


@pytest.mark.parametrize(
    ("text", "amount", "unit"),
    [
        ("90", 90, "s"),
        ("90s", 90, "s"),
        ("1.5m", 90, "s"),
        (" 5 m ", 300, "s"),
        ("2h", 7200, "s"),
        ("300MB", 300e6, "bytes"),
        ("2GB", 2e9, "bytes"),
        ("64KB", 64e3, "bytes"),
        ("100k", 100_000, "Gaussians"),
        ("35dB", 35, "dB"),
    ],
)
def test_every_kind_is_read_and_written_again(text, amount, unit):
    budget = Budget.parse(text)
    assert (budget.amount, budget.unit) == (amount, unit)
    assert Budget.parse(str(budget)) == budget


@pytest.mark.parametrize(
    "text", ["", "s", "5 parsecs", "5M", "5mb", "-3s", "0s", "0.0m", "nan", "inf", "1e400s", "9" * 400,
             "1KB", "0k", "0dB", "100dB", "35 db", "90s 5m"],
)  # fmt: skip
def test_nonsense_is_refused_in_one_sentence(text):
    with pytest.raises(InputError) as caught:
        Budget.parse(text)
    message = str(caught.value)
    assert message.startswith("A ")
    assert message.endswith(".")
    assert message.count("\n") == 0


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_the_file_of_that_many_gaussians_is_no_larger(toy_scene, tmp_path, degree):
    gaussians, appearance = toy_scene
    size = 100_000
    count = most_gaussians(size, degree)
    index = [i % len(gaussians) for i in range(count)]
    path = tmp_path / "splats.ply"
    write_ply(
        path,
        Gaussians(gaussians.rows(index)),
        appearance,
        degree,
        1.0,
        "a note that is as long as notes are" * 3,
    )
    assert len(read_ply(path)["x"]) == count
    assert 0.97 * size < path.stat().st_size <= size
    assert Budget(size, "bytes").gaussians == most_gaussians(size, 0) >= count


def test_what_is_foretold_of_a_power_law_is_its_end():
    """q = 40 - a n^-b with the exponent that the table has: two points of it give all others."""
    from recon.prediction import EXPONENT

    def quality(n: int) -> float:
        return 40 - 60 * n**-EXPONENT

    for n in (100, 400, 3000):
        found = predicted(Probe(100, 0.1, quality(100), quality(50)), n)
        assert found is not None
        assert found.db == pytest.approx(quality(n), abs=0.01)
        assert found.low < found.db < found.high
    near, far = (predicted(Probe(100, 0.1, 30.0, 29.0), n) for n in (150, 3000))
    assert isinstance(near, Prediction)
    assert isinstance(far, Prediction)
    assert near.high - near.low < far.high - far.low


def test_nothing_is_foretold_without_held_out_views_and_nothing_falls():
    assert predicted(Probe(100, 0.1, None, None), 500) is None
    worse = predicted(Probe(100, 0.1, 30.0, 31.0), 500)
    assert worse is not None
    assert worse.db == 30.0
