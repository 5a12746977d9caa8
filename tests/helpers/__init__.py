"""What tests share; the name of a module is its subject. `from tests.helpers.runs import ROOT`.

`live_page`, `scene_page` and `job_worker` are programs that tests start; `slow_wires` is a folder for PYTHONPATH.
"""
