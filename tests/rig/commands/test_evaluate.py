"""`rig evaluate`: the line that it prints."""

from rig.commands.evaluate import headline


def test_light_missing_from_far_away_is_in_the_line_that_is_printed() -> None:
    """The median and PSNR of a yard whose halo is two stops too dark are those of a good scene."""
    line = headline(
        {"hdr_psnr_mu_aligned": 33.4, "stops_median": 0.1, "stops_dark": 0.27, "stops_bright": 2.29}
    )
    assert "median error 0.100 stops" in line
    assert "of the darkest tenth 0.270 stops" in line
    assert "of the brightest hundredth 2.29 stops" in line
