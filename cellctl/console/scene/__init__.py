"""The 3-D scene and the charts of a run: their content from its journal, and their drawing."""

from cellctl.console.scene._content import SceneContent, scene_of
from cellctl.console.scene.charts import ChartsView, Series, charts_view, series_of
from cellctl.console.scene.run_points import ROBOTS, Points, Role, SceneRun, SceneSource
from cellctl.console.scene.view import SceneView, scene_view

__all__ = [
    "ROBOTS",
    "ChartsView",
    "Points",
    "Role",
    "SceneContent",
    "SceneRun",
    "SceneSource",
    "SceneView",
    "Series",
    "charts_view",
    "scene_of",
    "scene_view",
    "series_of",
]
