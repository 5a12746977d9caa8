"""What the simulated laser station is to the rest: its scheme, settings, faults and events."""

from __future__ import annotations

from sims.geocom._accuracy import PROFILES, baud_of, profile_of
from sims.simulator import FOR_MS, CannotStart, FaultKind, Setting, Setup, Simulator, Started


def _start(setup: Setup) -> Started:
    from sims.geocom._server import GeocomServer  # when a cell has the device

    try:
        setup.scene.station()
    except LookupError as error:
        raise CannotStart(str(error)) from None
    return GeocomServer(setup)


def _address_errors(address: str) -> list[str]:
    errors = []
    try:
        possible = baud_of(address) > 0
    except ValueError:
        possible = False
    if not possible:
        errors.append("baud is not a number above 0")
    if profile_of(address) not in PROFILES:
        errors.append(f"accuracy is not {' or '.join(PROFILES)}")
    return errors


SIMULATOR = Simulator(
    schemes=("geocom+serial",),
    start=_start,
    section="tracker",
    settings=(
        Setting("noise", "word", None, among=tuple(PROFILES), what="Noise profile; else the address's accuracy."),
        Setting("noise_scale", "number", 1.0, 0.0, what="Times the profile; 0: no noise."),
        Setting("collimation_arcsec", "number", 2.0, what="Of the line of sight; two faces remove it."),
        Setting("index_arcsec", "number", 3.0, what="Zero of the vertical circle; two faces remove it."),
        Setting("edm_s", "number", 1.0, 0.05, what="One distance in the standard program."),
        Setting("fine_adjust_s", "number", 2.0, 0.0, what="A fine adjustment without search."),
        Setting("lock_s", "number", 1.0, 0.0, what="Locking onto a reflector."),
        Setting("predict_s", "number", 1.5, 0.0, what="After a break of the beam, until the lock is lost."),
        Setting("speed_deg_s", "number", 45.0, 1.0, what="Of the motors."),
        Setting("reply_ms", "number", 4.0, 0.0, what="From a request's end or its work's end to the reply."),
    ),
    faults=(
        FaultKind("tracker.beam_broken", "something is in the beam: no reflector is seen", (FOR_MS,)),
        FaultKind("tracker.reflector_lost", "the reflector nearest to the beam is gone for good", momentary=True),
        FaultKind(
            "tracker.second_target",
            "a reflection beside the reflector that is searched",
            (Setting("beside_mm", "number", 20.0, 0.0, what="How far beside it."), FOR_MS),
        ),
        FaultKind(
            "tracker.tilt",
            "the instrument is tilted; the compensator's range is ± 4′",
            (Setting("arcmin", "number", 10.0, 0.0, what="By how much."), FOR_MS),
        ),
        FaultKind(
            "tracker.wrong_prism",
            "a person chooses another prism at the instrument",
            (Setting("prism", "whole", 1, what="Its number, as of BAP_SetPrismType; 1: mini prism, 17.5 mm."),),
            momentary=True,
        ),
        FaultKind("tracker.sleep", "the instrument goes to sleep", momentary=True),
        FaultKind("tracker.busy", "every request is refused as busy", (FOR_MS,)),
        FaultKind(
            "tracker.garbled",
            "a character of every n-th reply is wrong",
            (Setting("every", "whole", 1, 1, what="Each how many lines one is wrong."), FOR_MS),
        ),
        FaultKind(
            "tracker.late",
            "replies come late",
            (Setting("by_ms", "number", 3000.0, 0.0, what="By how much."), FOR_MS),
        ),
        FaultKind("tracker.doubled", "each reply comes twice", (FOR_MS,)),
        FaultKind("tracker.missing", "replies are lost", (FOR_MS,)),
    ),
    events={
        "tracker.aim": "the telescope begins to turn to a position",
        "tracker.lock": "it is locked onto a reflector",
        "tracker.measure": "a distance measurement begins",
    },
    address_errors=_address_errors,
)
