"""What can prove no model is refused before anything moves: a sphere of the fit, touches that are too few."""

from pathlib import Path

import pytest

from cellctl.files import InputError
from cellctl.operations.campaign import load_campaign

SELFCAL = Path(__file__).parents[2] / "procedures" / "sphere_selfcal.yaml"


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("prove_on=S1", "sphere S1 cannot prove a model that is made from it"),
        ("identify_on=", "sphere P1 cannot prove a model that is made from all spheres"),
        ("identify_on=S1, P1", "sphere P1 cannot prove a model that is made from it"),
        ("identify_on=S1, S2, S3, S4, S5, S6, S7, S8, S9", "50 touches are too few to judge a model by others, 54"),
        ("touches_fit=12", "18 touches or more"),
    ],
)  # fmt: skip
def test_a_campaign_that_could_prove_nothing_is_refused(setting, words):
    with pytest.raises(InputError) as refused:
        load_campaign(SELFCAL, None, [setting])
    assert words in str(refused.value)


@pytest.mark.long
def test_the_least_number_of_touches_is_enough_for_the_verdict():
    assert load_campaign(SELFCAL, None, ["touches_fit=18"]).parameters["touches_fit"] == 18
