"""A master that knows nothing of cellctl: canopen for the session, cantools for the same frames, decoded on its own.

Called with group and port of the bus; prints one JSON object of what it read.
"""

import json
import logging
import sys

import can
import canopen
import cantools
from canopen.objectdictionary import INTEGER16, INTEGER32, UNSIGNED8, UNSIGNED16, UNSIGNED32, ODRecord, ODVariable

NODES = range(1, 7)

MESSAGE = """
BO_ {id} Drive{node}: 8 Drive{node}
 SG_ Position : 0|32@1- (1,0) [0|0] "inc" Master
 SG_ Current : 32|16@1- (0.1,0) [0|0] "%" Master
 SG_ Torque : 48|16@1- (0.1,0) [0|0] "%" Master
"""
DBC = (
    'VERSION ""\nNS_ :\nBS_:\nBU_: Master '
    + " ".join(f"Drive{node}" for node in NODES)
    + "\n"
    + "".join(MESSAGE.format(id=0x180 + node, node=node) for node in NODES)
)


def dictionary():
    """What the master uses of a drive."""
    found = canopen.ObjectDictionary()
    variables = [
        ("Heartbeat", 0x1017, UNSIGNED16),
        ("Statusword", 0x6041, UNSIGNED16),
        ("Position", 0x6064, INTEGER32),
        ("Rated current", 0x6075, UNSIGNED32),
        ("Rated torque", 0x6076, UNSIGNED32),
        ("Torque", 0x6077, INTEGER16),
        ("Current", 0x6078, INTEGER16),
    ]
    for name, index, kind in variables:
        variable = ODVariable(name, index)
        variable.data_type = kind
        found.add_object(variable)
    parameter, mapping = ODRecord("TPDO1", 0x1800), ODRecord("TPDO1 mapping", 0x1A00)
    kinds = (UNSIGNED8, UNSIGNED32, UNSIGNED8), (UNSIGNED8, *(UNSIGNED32,) * 8)
    for record, members in zip((parameter, mapping), kinds, strict=True):
        for subindex, kind in enumerate(members):
            member = ODVariable(f"{record.name} {subindex}", record.index, subindex)
            member.data_type = kind
            record.add_member(member)
        found.add_object(record)
    return found


def main(group, port):
    """NMT start, rated values by SDO, mapping, SYNC; every frame decoded by canopen and by cantools."""
    logging.disable(logging.CRITICAL)
    decoder = cantools.database.load_string(DBC, "dbc")
    network = canopen.Network()
    network.connect(interface="udp_multicast", channel=group, port=port, hop_limit=0, fd=False)
    frames = can.BufferedReader()
    network.notifier.add_listener(frames)
    drives = [network.add_node(node, dictionary()) for node in NODES]
    network.nmt.state = "PRE-OPERATIONAL"
    for drive in drives:
        drive.tpdo[1].read()
        drive.tpdo[1].clear()
        for name in ("Position", "Current", "Torque"):
            drive.tpdo[1].add_variable(name)
        drive.tpdo[1].trans_type, drive.tpdo[1].enabled = 1, True
        drive.tpdo[1].save()
        drive.sdo["Heartbeat"].raw = 200
    network.nmt.state = "OPERATIONAL"
    states = [drive.nmt.wait_for_heartbeat(10.0) for drive in drives]
    while frames.get_message(0.0):
        pass
    network.sync.transmit()
    by_cantools = {}
    while len(by_cantools) < len(drives) and (message := frames.get_message(10.0)):
        if 0x180 < message.arbitration_id <= 0x186:
            signals = decoder.decode_message(message.arbitration_id, message.data)
            by_cantools[message.arbitration_id - 0x180] = [signals[name] for name in ("Position", "Current", "Torque")]
    by_canopen = {drive.id: [variable.raw for variable in drive.tpdo[1]] for drive in drives}  # heard before `frames`
    print(
        json.dumps(
            {
                "ours": sorted({name.partition(".")[0] for name in sys.modules} & {"cellctl", "drivers", "sims"}),
                "states": states,
                "canopen": by_canopen,
                "cantools": by_cantools,
                "rated_ma": [drive.sdo["Rated current"].raw for drive in drives],
                "rated_mnm": [drive.sdo["Rated torque"].raw for drive in drives],
                "position": [drive.sdo["Position"].raw for drive in drives],
                "current": [drive.sdo["Current"].raw for drive in drives],
                "statusword": [drive.sdo["Statusword"].raw for drive in drives],
            }
        )
    )
    network.disconnect()


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
