"""A client that knows nothing of deltaph: copy it, it needs eclipse-zenoh only. `python plain_client.py [ENDPOINT [CELL]]`.

It prints every setpoint, and says how many of each message came and how many are missing when the cell ends.
"""

import json
import struct
import sys
import threading

import zenoh

FORMATS = {"uint64": "<Q", "float64": "<d", "int32": "<i"}
endpoint, cell = (*sys.argv[1:], *("tcp/127.0.0.1:7447", "cell1")[len(sys.argv) - 1 :])
config = zenoh.Config.from_json5(json.dumps({"mode": "client", "connect": {"endpoints": [endpoint]}}))
received: dict[str, int] = {}
numbers: dict[str, list[int]] = {}  # first and last
ended = threading.Event()


def on_sample(sample: zenoh.Sample) -> None:
    """Decode a message with the offsets that the cell tells."""
    name, payload = str(sample.key_expr).rpartition("/")[2], sample.payload.to_bytes()
    if name == "summary":
        ended.set()
    elif name in schema:
        values = {f["name"]: struct.unpack_from(FORMATS[f["type"]], payload, f["offset"])[0] for f in schema[name]["fields"]}
        received[name] = received.get(name, 0) + 1
        numbers[name] = [numbers.get(name, [values["sequence"]])[0], values["sequence"]]
        if name == "setpoint":
            print(f"{values['time']:.3f} s", *(f"{values[f'joint[{i}].position']:.6f}" for i in (1, 2, 3)), "rad")


with zenoh.open(config) as session:
    answers = [reply.ok.payload.to_bytes() for reply in session.get(f"deltaph/{cell}/schema") if reply.ok is not None]
    if not answers:
        sys.exit(f"there is no cell {cell} on {endpoint}")
    schema = json.loads(answers[0])["messages"]
    session.declare_subscriber(f"deltaph/{cell}/*", on_sample)
    ended.wait()
for name, (first, last) in numbers.items():
    print(f"{name}: {received[name]} received, {last - first + 1 - received[name]} missing")
