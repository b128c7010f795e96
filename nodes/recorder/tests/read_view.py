"""Decodes every message of a recording's protobuf channels with mcap-protobuf-support and says what it found, as JSON."""
import json
import sys

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

counts, schemas, late, found = {}, {}, {}, {}
with open(sys.argv[1], "rb") as file:
    reader = make_reader(file, decoder_factories=[DecoderFactory()])
    for schema, channel, message in reader.iter_messages():
        if channel.message_encoding != "protobuf":
            continue
        decoder = DecoderFactory().decoder_for(channel.message_encoding, schema)
        decoded = decoder(message.data)
        counts[channel.topic] = counts.get(channel.topic, 0) + 1
        schemas[channel.topic] = schema.name
        stamp = getattr(decoded, "timestamp", None)
        if stamp is not None:
            late[channel.topic] = message.log_time - (stamp.seconds * 10**9 + stamp.nanos)
        if channel.topic == "/view/local_map":
            occupied = []
            for index in range(len(decoded.data) // decoded.cell_stride):
                if decoded.data[index * decoded.cell_stride] == 255:
                    row, column = divmod(index, decoded.column_count)
                    x = decoded.pose.position.x + (column + 0.5) * decoded.cell_size.x
                    y = decoded.pose.position.y + (row + 0.5) * decoded.cell_size.y
                    occupied.append([round(x, 3), round(y, 3)])
            found["occupied"] = occupied
        elif channel.topic == "/view/tf":
            frames = found.setdefault("frames", [])
            frames += [f"{t.parent_frame_id}>{t.child_frame_id}" for t in decoded.transforms]
        elif channel.topic == "/view/command":
            found["command"] = [decoded.v_m_s, decoded.w_rad_s, decoded.reason, decoded.winner, decoded.source_frame]
        elif channel.topic == "/view/latency":
            found["latency"] = decoded.depth_to_command_ms
        elif channel.topic == "/view/camera":
            found["camera"] = [decoded.width, decoded.height, *decoded.K]
        elif channel.topic == "/view/log":
            found.setdefault("log", []).append([decoded.level, decoded.name, decoded.message])
        elif channel.topic == "depth":
            found["image"] = [decoded.width, decoded.height, decoded.encoding, len(decoded.data)]
found["frames"] = sorted(set(found.get("frames", [])))
print(json.dumps({"counts": counts, "schemas": schemas, "late": late, "found": found}))
