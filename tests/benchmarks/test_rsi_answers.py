"""RSI answers in real time with on-line correction, beside two busy loops and RSIPI's driver, which sends zeros."""

from __future__ import annotations

import importlib.util

import pytest

from tests.studies import rsi_answers as study

SECONDS = 20.0


@pytest.mark.long
@pytest.mark.skipif(importlib.util.find_spec("RSIPI") is None, reason="RSIPI is not installed (group 'peers')")
def test_no_telegram_is_lost_while_a_large_model_corrects(tell) -> None:
    ours, peer = study.compare(SECONDS, "ipo_fast", rights=True, ours=study.ONLINE)
    for name, share in study.SHARES.items():
        a, b = ours.within_ms(share), peer.within_ms(share)
        tell(f"RSI answer with correction, {name}", f"{a:.2f} ms", f"RSIPI's zeros: {b:.2f} ms", f"{a / b:.1f} ×", "–")
    tell("late, not answered", f"{ours.late}, {ours.none}", f"RSIPI: {peer.late}, {peer.none}", "–", "none lost")
    tell("model's part of a cycle, p99", f"{ours.model_us(0.99):g} µs", "–", "–", "200 µs on a quiet machine")
    assert ours.counts["telegrams"] == ours.asked
    assert ours.counts["skipped"] == ours.none, "what is not answered was overtaken by a newer telegram"
    assert ours.counts["cycles"] > 0.9 * (ours.asked - ours.none)
