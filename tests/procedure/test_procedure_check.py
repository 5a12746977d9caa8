"""Every error is found before anything moves, at once, at its place, with its cure."""

import pytest

from cellctl.devices import ContactProbe, SearchingRobot
from cellctl.files import InputError
from cellctl.procedure import checked_parameters


def test_a_good_procedure_has_no_errors(errors, good):
    assert errors(good) == []


def test_no_step_is_tried_again_after_an_uncertain_state(errors, good):
    (error,) = errors(good.replace("NoContact", "DeviceUncertain"))
    assert "never tried again after DeviceUncertain" in error


def test_five_errors_are_named_at_once_each_with_its_place_and_cure(errors, good):
    text = (
        good.replace("do: sphere.plan", "do: sphere.pln")
        .replace('speed_mm_s: "${search_speed}"', "speed_mm_s: 50")
        .replace("timeout: 90", "timeout: -1")
        .replace("NoContact", "NoContakt")
        .replace("title:", "titel:")
    )
    assert errors(text) == [
        "2:1: 'titel' is not known in a procedure\n    did you mean 'title'?",
        "11:9: there is no step 'sphere.pln'\n    did you mean 'sphere.plan'?",
        "20:47: input 'speed_mm_s' of sphere.touch: has to be at most 20 (here: 50)\n    give at most 20",
        "21:18: 'timeout' of a step is not usable (here: -1)\n    write a number above 0",
        "22:35: there is no error 'NoContakt' that sphere.touch could be tried again after\n"
        "    did you mean 'NoContact'?",
    ]


@pytest.mark.parametrize(
    ("right", "wrong", "expected"),
    [
        ("id: plan\n", "id: plan\n    @tiemout: 3\n", "'tiemout' is not known in a step\n    did you mean 'timeout'?"),
        ("id: plan\n", "id: @Plan!\n", "'id' of a step is not usable (here: 'Plan!')\n    a name is small letters"),
        ("- id: plan\n    do: sphere.plan\n", "- @id: plan\n", "'do' is missing in a step\n    add 'do:'"),
        ('"${touches_fit}"', "@5", "input 'fit' of sphere.plan: has to be at least 10 (here: 5)"),
        ('"${touches_fit}"', "@many", "input 'fit' of sphere.plan: has to be a whole number (here: 'many')"),
        ('"${touches_fit}"', '@"50"', "input 'fit' of sphere.plan: has to be a whole number (here: '50')"),
        ('"${touches_fit}"', "@true", "input 'fit' of sphere.plan: has to be a whole number (here: True)"),
        ('"${touches_fit}"', "@.nan", "this is no finite number"),
        (
            '{fit: "${touches_fit}", ',
            "@{",
            "step sphere.plan needs the input 'fit'\n    add 'fit:' under 'with:' (touches",
        ),
        ("{fit:", "{fit: 50, @fitt:", "step sphere.plan has no input 'fitt'\n    did you mean 'fit'?"),
        ('order: "${order}"', '@ordr: "${order}"', "step sphere.plan has no input 'ordr'\n    did you mean 'order'?"),
        ("{touch: ", '{@toch: "${touch}", touch: ', "step sphere.touch has no input 'toch'\n    did you mean 'touch'?"),
        ('"${order}"', "@sideways", "input 'order' of sphere.plan: has to be 'random' or 'nearest' (here: 'sideways')"),
        ('"${touches_fit}"', '@"${touch_fit}"', "${touch_fit}: nothing here is called 'touch_fit'\n    did you mean"),
        (
            '"${touches_fit}"',
            '@"${touches_fit} + 1"',
            "'${touches_fit} + 1' is no reference\n    a reference is a whole",
        ),
        ('"${touches_fit}"', '@"${touches_fit.x}"', "${touches_fit.x}: a whole number has no field 'x'"),
        ('"${order}"', '@"${points}"', "'points' is a loop and has no result"),
        ('"${order}"', '@"${plan.seconds}"', "step 'plan' refers to its own result"),
        ('"${order}"', '@"${hold}"', "${hold} refers to step 'hold', which comes later (line 24)"),
        (
            "${plan.touches}",
            "@${plan.tuches}",
            "${plan.tuches}: Plan has no field 'tuches'\n    did you mean 'touches'?",
        ),
        ("${plan.touches}", "@${plan.seconds}", "'for_each' takes a list; ${plan.seconds} is a number"),
        ("${plan.touches}", "@${search_speed}", "'for_each' takes a list; ${search_speed} is a number"),
        ("${plan.touches}", "@five", "'for_each' takes a list\n    name one"),
        ("as: touch", "as: @order", "the loop's variable 'order' hides a parameter of that name"),
        ("as: touch", "as: @plan", "the loop's variable 'plan' hides a step of that name"),
        ('"${touch}"', '@"${touch.jonts}"', "${touch.jonts}: Target has no field 'jonts'\n    did you mean 'joints'?"),
        ('"${touch}"', '@"${plan.touches[0].name.first}"', "${plan.touches[0].name.first}: text has no field 'first'"),
        ('"${touch}"', '@"${plan.touches.name}"', "${plan.touches.name}: a list has no field 'name'"),
        ("id: hold", "id: @plan", "'plan' names two steps (the first on line 10)"),
        ("id: hold", "id: @order", "'order' is also a parameter"),
        ("timeout: 10}", "timeout: @0}", "'timeout' of a step is not usable (here: 0)\n    write a number above 0"),
        (
            "attempts: 2",
            "attempts: @0",
            "'attempts' of retry is not usable (here: 0)\n    write a whole number, 1 or more",
        ),
        ("{attempts: 2, on: [NoContact]}", "@{attempts: 2}", "attempts without an error to try again after"),
        (
            "default: 50, min: 10",
            "default: @50, min: 60",
            "the default of 'touches_fit' is out of its range (here: 50)",
        ),
        ("default: 50", "default: @few", "the default of 'touches_fit' takes a whole number (here: 'few')"),
        (
            "default: random",
            "default: @radnom",
            "the default of 'order' has no choice 'radnom'\n    did you mean 'random'?",
        ),
        ("min: 0.5, max: 20", "min: @20, max: 0.5", "min is above max in parameter 'search_speed'"),
        (
            "type: flag",
            "type: @bool",
            "'type' of parameter 'quick' is not usable (here: 'bool')\n    write one of: integer",
        ),
        (
            "procedure: sphere",
            "procedure: @Sphere",
            "'procedure' of a procedure is not usable (here: 'Sphere_selfcal')",
        ),
        (
            "  - {id: hold, do: robot.stop, timeout: 10}",
            "  - @{id: h, for_each: [], as: i, steps: []}",
            "clean-up has no",
        ),
    ],
)
def test_each_error_stands_where_it_is_with_what_to_do(errors, good, right, wrong, expected):
    """`@` stands before the place at which the error has to be reported."""
    assert right in good
    marked = good.replace(right, wrong, 1)
    before = marked[: marked.index("@")]
    place = f"{before.count(chr(10)) + 1}:{len(before) - before.rfind(chr(10))}"
    found = errors(marked.replace("@", ""))
    assert any(error.startswith(f"{place}: {expected}") for error in found), found


@pytest.mark.parametrize("text", ["", "[]", "procedure: p\n", "procedure: p\nsteps: []\n", "procedure: p\nsteps: 3\n"])
def test_a_procedure_without_steps_is_refused(errors, text):
    assert any("step" in error for error in errors(text))


@pytest.mark.parametrize(
    ("right", "wrong"),
    [("do: sphere.plan", "do: x.plan"), ("type: integer", "type: int"), ("${plan.touches}", "${plan.tuches}")],
)
def test_what_follows_from_an_error_is_not_reported_as_another(errors, good, right, wrong):
    assert len(errors(good.replace(right, wrong, 1))) == 1


def test_a_name_that_could_mean_the_variable_or_the_result_is_refused(errors, good):
    later = '      - {id: again, do: sphere.touch, with: {touch: "${touch}", speed_mm_s: 5}}\ncleanup:'
    found = errors(good.replace("cleanup:", later))
    assert found == [
        "23:53: ${touch} could be the loop's variable or the result of step 'touch'\n    give one of them another name"
    ]


def test_the_result_of_a_step_without_one_cannot_be_referred_to(errors, good):
    later = '      - {id: again, do: sphere.touch, with: {touch: "${first}", speed_mm_s: 5}}\ncleanup:'
    found = errors(good.replace("- id: touch", "- id: first").replace("cleanup:", later))
    assert found == ["23:53: step 'first' gives no result\n    remove the reference"]


def test_clean_up_uses_no_result_since_it_may_begin_before_any(errors, good):
    found = errors(good.replace("do: robot.stop,", 'do: sphere.plan, with: {fit: "${plan.seconds}"},'))
    assert "clean-up cannot use the result of 'plan'" in found[0]


def test_a_loop_variable_is_unknown_outside_its_loop(errors, good):
    found = errors(good.replace("as: touch", "as: one").replace('"${touch}"', '"${one}"').replace("${order}", "${one}"))
    assert found[0].startswith("12:42: 'one' is the variable of loop 'points' and is known only inside it")


def test_values_that_the_run_will_tell_are_left_alone_the_others_are_not(errors, good):
    text = good.replace(
        'touch: "${touch}"',
        'options: {a: "${plan.seconds}", b: wide}, ladder: ["${plan.seconds}", 1], touch: "${touch}"',
    )
    assert [m.split(" (here")[0] for m in errors(text)] == [
        "20:51: input 'options.b' of sphere.touch: has to be a number"
    ]


def test_a_parameter_out_of_the_steps_range_is_found_through_the_reference(errors, good):
    found = errors(good, parameters={"touches_fit": 5000, "search_speed": 5.0, "order": "random"})
    assert found == [
        "12:17: input 'fit' of sphere.plan: has to be at most 2000 (here: 5000)\n"
        "    give at most 2000 (touches to identify from)"
    ]


def test_a_device_that_the_cell_has_not_is_named_once(errors, good):
    found = errors(good, devices={"robot": None})
    assert [error.splitlines()[0] for error in found] == [
        "19:13: step sphere.touch needs a device 'probe', and the cell has none"
    ]


def test_a_driver_that_cannot_do_what_the_step_needs_is_named_with_what_it_lacks(errors, good):
    found = errors(good, devices={"robot": SearchingRobot, "probe": SearchingRobot})
    assert "needs 'probe' to be a ContactProbe, and its driver lacks arm, contact, disarm" in found[0]
    assert errors(good, devices={"robot": SearchingRobot, "probe": ContactProbe}) == []


def test_a_device_that_a_step_can_do_without_is_checked_only_where_the_cell_has_it(errors):
    text = "procedure: weigh\ntitle: Weigh\nsteps:\n  - {id: weigh, do: sphere.weigh}\n"
    assert errors(text, devices={"robot": None}) == []
    found = errors(text, devices={"probe": SearchingRobot})
    assert "needs 'probe' to be a ContactProbe, and its driver lacks arm, contact, disarm" in found[0]


def test_nothing_is_reported_of_devices_where_the_cell_is_not_known(errors, good):
    assert errors(good, devices=None) == []


def test_errors_in_the_settings_come_together_with_those_in_the_file(load, good, registry):
    procedure = load(good.replace("sphere.plan", "sphere.pln"))
    with pytest.raises(InputError) as caught:
        checked_parameters(procedure, ["touches_fot=3", "search_speed=fast"], registry, None)
    assert [problem.what for problem in caught.value.problems] == [
        "'search_speed' takes a number (here: 'fast')",
        "procedure 'sphere_selfcal' has no parameter 'touches_fot'",
        "there is no step 'sphere.pln'",
    ]
