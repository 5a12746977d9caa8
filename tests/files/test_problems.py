"""Many problems alike are said once, with their lines."""

from cellctl.files import Problem, grouped


def test_many_refused_rows_that_differ_in_figures_alone_are_one_problem_with_all_lines() -> None:
    refused = [
        Problem("t.csv", line, 0, f"A2 {line}.5° is outside the limits", "leave it out") for line in (*range(2, 40), 45)
    ]
    other = Problem("t.csv", 4, 0, "is not reached", "leave it out")
    found = grouped([*refused, other])
    assert [each.line for each in found] == [2, 4]
    assert found[0].what == "A2 2.5° is outside the limits; so in 39 places, lines 2–39, 45"
    assert found[1] == other


def test_a_few_problems_and_those_of_a_whole_file_stay_as_they_are() -> None:
    few = [Problem("t.csv", line, 0, f"{line} is wrong") for line in (1, 2, 3)]
    whole = [Problem("t.csv", 0, 0, f"option {number} is wrong") for number in range(6)]
    assert grouped(few) == few
    assert grouped(whole) == whole
