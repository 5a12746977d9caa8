"""Every mistake is found before anything moves, at once, at its place, with its cure."""

import pytest

from cellctl.files import InputError
from cellctl.procedure import checked_parameters


def test_a_good_procedure_has_no_mistakes(mistakes, good):
    assert mistakes(good) == []


def test_five_mistakes_are_named_at_once_each_with_its_place_and_cure(mistakes, good):
    text = (
        good.replace("do: sphere.plan", "do: sphere.pln")
        .replace('speed_mm_s: "${search_speed}"', "speed_mm_s: 50")
        .replace("timeout: 90", "timeout: -1")
        .replace("NoContact", "NoContakt")
        .replace("title:", "titel:")
    )
    found = mistakes(text)
    assert found == [
        "2:1: 'titel' is not known in a procedure\n    did you mean 'title'?",
        "11:9: there is no step 'sphere.pln'\n    did you mean 'sphere.plan'?",
        "20:47: input 'speed_mm_s' of sphere.touch: should be less than or equal to 20 (here: 50)\n    give at most 20",
        "21:18: 'timeout' of a step is not usable (here: -1)\n    write a number above 0",
        "22:35: there is no error 'NoContakt' that sphere.touch could be tried again after\n    did you mean 'NoContact'?",
    ]
