"""Names in the cell file: of the proxies, and of the events that the controller announces."""

from __future__ import annotations

JOB = "varproxy.job"
ROW = "varproxy.row"
C3, KUKAVARPROXY = "c3_bridge", "kukavarproxy"
