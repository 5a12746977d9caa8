"""The link table of the KUKA KR5 R1400 as published (Wang et al. 2024, doi 10.3390/app14219824)."""

KR5_TABLE = [(0, 400, 180, -90), (0, 0, 600, 0), (-90, 0, 40, -90), (0, 620, 0, 90), (180, 0, 0, 90), (0, 80, 0, 0)]
"""theta, d, a, alpha of each link, deg and mm: Rz(q + theta) Tz(d) Tx(a) Rx(alpha)."""
