"""Messages are CDR, laid out as the schema says, from the variable tables and nothing else."""

import json
import struct
from dataclasses import fields
from typing import Any

import numpy as np
import pytest
from integration.synthetic_cell import random_frame, values_of
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from deltaph.frame import TIMING
from deltaph.telemetry import MESSAGE_NAMES, MessageName, layout, schema_document
from deltaph.telemetry.keys import FRAME_MESSAGES
from deltaph.variables import variable_table

SIZES = {"uint64": 8, "float64": 8, "int32": 4}
FORMATS = {"uint64": "<Q", "float64": "<d", "int32": "<i"}

each_message = pytest.mark.parametrize("name", [*FRAME_MESSAGES, "plan"])  # an event is not a frame: test_events.py


def schema_of(name: MessageName) -> dict[str, Any]:
    """As a foreign reader gets it: through JSON."""
    schema: dict[str, Any] = json.loads(json.dumps(schema_document()))["messages"][name]
    return schema


@each_message
def test_reader_with_nothing_but_the_schema_gets_every_value(name: MessageName) -> None:
    for step in (0, 1, 2**40):
        frame = random_frame(step)
        payload = layout(name).encode(frame, sequence=step + 3)
        schema = schema_of(name)
        assert payload[:4].hex(" ") == schema["header"] == "00 01 00 00"
        assert len(payload) == schema["size"]
        read = {f["name"]: struct.unpack_from(FORMATS[f["type"]], payload, f["offset"])[0] for f in schema["fields"]}
        assert read == {"sequence": step + 3, **values_of(frame)[name]}


@each_message
def test_ros_reads_the_bytes_with_the_published_definition(name: MessageName) -> None:
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(schema_of(name)["ros_message"], f"deltaph/msg/{name.capitalize()}"))
    frame = random_frame(11)
    read = store.deserialize_cdr(layout(name).encode(frame, sequence=3), f"deltaph/msg/{name.capitalize()}")
    values = [getattr(read, field.name) for field in fields(read) if field.name.islower() and not field.name.startswith("_")]
    assert values == list({"sequence": 3, **values_of(frame)[name]}.values())


@each_message
def test_fields_are_aligned_to_the_end_of_the_header_and_leave_no_gap(name: MessageName) -> None:
    found = schema_of(name)["fields"]
    assert [(f["name"], f["type"], f["offset"]) for f in found[:3]] == [
        ("sequence", "uint64", 4),
        ("time", "float64", 12),
        ("unix_time_ns", "uint64", 20),
    ]
    end = 4
    for field in found:
        assert field["offset"] == end
        assert (field["offset"] - 4) % SIZES[field["type"]] == 0
        end += SIZES[field["type"]]
    assert end == schema_of(name)["size"]


def test_messages_carry_every_output_once() -> None:
    def names(message: MessageName) -> set[str]:
        return {field.name for field in layout(message).fields} - {"sequence", "time", "unix_time_ns"}

    assert not names("setpoint") & names("plan")
    assert names("setpoint") | names("plan") == {v.name for v in variable_table("planner").of("output")}
    assert names("actual") == {v.name for v in variable_table("plant").of("output")}
    assert names("timing") == {name for name, _, _ in TIMING}


def test_schema_carries_units_and_enumerations() -> None:
    setpoint = {field["name"]: field for field in schema_of("setpoint")["fields"]}
    assert setpoint["joint[2].velocity"]["unit"] == "rad/s"
    assert setpoint["path.phase"]["enumeration"][:2] == ["idle", "lift"]
    assert "enumeration" not in setpoint["tcp.position.x"]
    plan = {field["name"]: field for field in schema_of("plan")["fields"]}
    assert plan["plan.status"]["enumeration"][:2] == ["none", "ok"]
    assert plan["plan.busy"]["enumeration"] == ["false", "true"]
    assert "enumeration" not in plan["plan.count"]


def test_encodings_name_the_message_and_its_version() -> None:
    assert [layout(name).encoding for name in MESSAGE_NAMES] == [
        f"application/cdr;deltaph.{name}" for name in ("Setpoint;v=1", "Actual;v=1", "Timing;v=3", "Plan;v=2", "Event;v=2")
    ]


@each_message
def test_decode_is_the_inverse_of_encode(name: MessageName) -> None:
    frame = random_frame(7)
    record = layout(name).decode(layout(name).encode(frame, sequence=7))
    assert layout(name).as_dict(record) == {"sequence": 7, **values_of(frame)[name]}


@each_message
def test_records_of_frames_are_the_decoded_messages(name: MessageName) -> None:
    frames = [random_frame(step) for step in range(5)]
    records = layout(name).records(frames)
    assert records.tobytes() == b"".join(layout(name).encode(frame, frame.step) for frame in frames)
    assert len(layout(name).records([])) == 0


def test_groups_are_read_as_arrays() -> None:
    frame = random_frame(1)
    records = layout("actual").records([frame] * 4)
    expected = [values_of(frame)["actual"][f"joint[{i}].position"] for i in (1, 2, 3)]
    assert np.array_equal(layout("actual").values(records, "joint_position"), [expected] * 4)
    assert layout("actual").values(records, "trip").shape == (4,)
    with pytest.raises(KeyError, match="gripper"):
        layout("actual").values(records, "gripper")


def test_what_is_not_the_message_is_refused() -> None:
    payload = layout("timing").encode(random_frame(1), sequence=0)
    for wrong in (b"", payload[:-1], payload + b"\0", b"\0\0\0\0" + payload[4:]):
        with pytest.raises(ValueError, match="not a Timing message"):
            layout("timing").decode(wrong)
