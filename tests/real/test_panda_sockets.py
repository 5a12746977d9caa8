"""Real measurements: a Franka Panda's ball, which nobody taught, in two sockets of a plate at three places."""

import json

import pytest

from tests.helpers.real_data import DATA, PLACES, cellctl, visits

pytestmark = pytest.mark.skipif(not (DATA / "panda_sockets").exists(), reason=f"no sockets at {DATA}")


@pytest.mark.long
def test_a_tool_that_was_never_found_is_no_gain_of_the_model(tmp_path, capsys):
    data = visits("panda", PLACES["panda"], tmp_path / "panda.csv")
    options = ["--model", "geometry", "--by", "session", "--json", tmp_path / "r.json"]
    assert cellctl("fit", "panda", data, *options) == 0
    result = json.loads((tmp_path / "r.json").read_text())
    assert result["nominal"]["mean"] > 60.0  # the sockets' places alone, as documented
    assert result["nominal_with_tool"]["mean"] == pytest.approx(8.4, abs=0.1)
    assert result["sentence"].startswith("Error of held-out socket visits: 8.408 mm nominal with the tool registered, ")
    assert "Better than nominal with the tool registered." in result["sentence"]
    assert all(
        each["nominal_with_tool"]["mean"] < 10.0 < 60.0 < each["nominal"]["mean"] for each in result["by"].values()
    )
    assert "held out, nominal with the tool registered" in capsys.readouterr().out
