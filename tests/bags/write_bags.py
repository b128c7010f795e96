"""Writes ROS 2 bags with a writer that has nothing to do with sidestep: PyPI mcap-ros2-support.

write_bags.py small FOLDER                        the bags in tests/data/bags
write_bags.py walk FOLDER RATE FLOOR OUT [PIXELS] a folder of depth images with poses; compressed as its PNG files
                                                  are, or raw from a file of all pixels
write_bags.py read BAG                            decodes every message, prints topic, type and count
"""

import math
import os
import struct
import sys
import zlib
from types import SimpleNamespace as Record

from mcap.reader import make_reader
from mcap.writer import Writer as PlainWriter
from mcap_ros2.decoder import DecoderFactory
from mcap_ros2.writer import Writer

TIME = "int32 sec\nuint32 nanosec\n"
HEADER = "builtin_interfaces/Time stamp\nstring frame_id\n"
PARTS = {
    "builtin_interfaces/Time": TIME,
    "std_msgs/Header": HEADER,
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
    "geometry_msgs/Pose": "Point position\nQuaternion orientation\n",
    "geometry_msgs/PoseWithCovariance": "Pose pose\nfloat64[36] covariance\n",
    "geometry_msgs/Twist": "Vector3 linear\nVector3 angular\n",
    "geometry_msgs/TwistWithCovariance": "Twist twist\nfloat64[36] covariance\n",
    "geometry_msgs/Transform": "Vector3 translation\nQuaternion rotation\n",
    "geometry_msgs/TransformStamped": "std_msgs/Header header\nstring child_frame_id\nTransform transform\n",
    "sensor_msgs/RegionOfInterest": "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify\n",
}
TOPS = {
    "sensor_msgs/msg/Image": "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\n"
    "uint8 is_bigendian\nuint32 step\nuint8[] data\n",
    "sensor_msgs/msg/CompressedImage": "std_msgs/Header header\nstring format\nuint8[] data\n",
    "sensor_msgs/msg/CameraInfo": "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\n"
    "float64[] d\nfloat64[9] k\nfloat64[9] r\nfloat64[12] p\nuint32 binning_x\nuint32 binning_y\nRegionOfInterest roi\n",
    "sensor_msgs/msg/LaserScan": "std_msgs/Header header\nfloat32 angle_min\nfloat32 angle_max\n"
    "float32 angle_increment\nfloat32 time_increment\nfloat32 scan_time\nfloat32 range_min\nfloat32 range_max\n"
    "float32[] ranges\nfloat32[] intensities\n",
    "nav_msgs/msg/Odometry": "std_msgs/Header header\nstring child_frame_id\n"
    "geometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist\n",
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms\n",
    "std_msgs/msg/String": "string data\n",
}
LINE = "=" * 80 + "\n"
START_NS = 1_700_000_000_000_000_000
WIDTH, HEIGHT, FRAMES = 32, 24, 5


def text(top):
    return TOPS[top] + "".join(f"{LINE}MSG: {name}\n{part}" for name, part in PARTS.items())


def header(at_ns, frame):
    return Record(stamp=Record(sec=at_ns // 10**9, nanosec=at_ns % 10**9), frame_id=frame)


def vector(x=0.0, y=0.0, z=0.0):
    return Record(x=x, y=y, z=z)


def rotation(x=0.0, y=0.0, z=0.0, w=1.0):
    return Record(x=x, y=y, z=z, w=w)


def yaw(angle):
    return rotation(z=math.sin(angle / 2), w=math.cos(angle / 2))


OPTICAL = rotation(-0.5, 0.5, -0.5, 0.5)


def transform(at_ns, parent, child, place, turn):
    return Record(header=header(at_ns, parent), child_frame_id=child, transform=Record(translation=place, rotation=turn))


def odometry(at_ns, pose, twist=(0.0, 0.0), frames=("odom", "base_link")):
    x, y, angle = pose
    return Record(
        header=header(at_ns, frames[0]),
        child_frame_id=frames[1],
        pose=Record(pose=Record(position=vector(x, y), orientation=yaw(angle)), covariance=[0.0] * 36),
        twist=Record(twist=Record(linear=vector(twist[0]), angular=vector(z=twist[1])), covariance=[0.0] * 36),
    )


def camera_info(at_ns, frame, width, height, k):
    fx, fy, cx, cy = k
    return Record(
        header=header(at_ns, frame), height=height, width=width, distortion_model="plumb_bob", d=[0.0] * 5,
        k=[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0], r=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p=[fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0], binning_x=0, binning_y=0,
        roi=Record(x_offset=0, y_offset=0, height=0, width=0, do_rectify=False),
    )


def image(at_ns, frame, width, height, encoding, data, step, big=0):
    return Record(header=header(at_ns, frame), height=height, width=width, encoding=encoding, is_bigendian=big,
                  step=step, data=data)


class Bag:
    def __init__(self, path):
        self.file = open(path, "wb")
        self.writer = Writer(self.file, chunk_size=1 << 20)
        self.schemas = {}

    def write(self, topic, top, at_ns, message, delay_ns=0):
        if top not in self.schemas:
            self.schemas[top] = self.writer.register_msgdef(top, text(top))
        self.writer.write_message(topic, self.schemas[top], message, log_time=at_ns + delay_ns, publish_time=at_ns)

    def close(self):
        self.writer.finish()
        self.file.close()


def millimetres(frame, row, col, width=WIDTH):
    """The picture that the tests expect: every seventh column has no measurement."""
    return 0 if col % 7 == 0 else 1000 + 100 * frame + 10 * row + col


def pixels(frame, width=WIDTH, height=HEIGHT):
    return [[millimetres(frame, row, col) for col in range(width)] for row in range(height)]


def png(rows):
    def chunk(name, body):
        return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))

    raw = b"".join(b"\0" + struct.pack(f">{len(row)}H", *row) for row in rows)
    head = struct.pack(">IIBBBBB", len(rows[0]), len(rows), 16, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(raw, 9)) + chunk(b"IEND", b"")


def depth(bag, kind, frame, at_ns, rvl):
    rows, flat = pixels(frame), [value for row in pixels(frame) for value in row]
    raw = "/camera/depth/image_rect_raw"
    delay_ns = 15_000_000
    optical = "camera_optical_frame"
    compressed = lambda form, body: bag.write(
        raw + "/compressedDepth", "sensor_msgs/msg/CompressedImage", at_ns,
        Record(header=header(at_ns, optical), format=form, data=body), delay_ns)
    plain = lambda encoding, data, step, big=0, topic=raw: bag.write(
        topic, "sensor_msgs/msg/Image", at_ns,
        image(at_ns, optical, WIDTH, HEIGHT, encoding, data, step, big), delay_ns)
    if kind == "raw":
        plain("16UC1", b"".join(struct.pack(f"<{WIDTH}H", *row) + b"padded" for row in rows), 2 * WIDTH + 6)
    elif kind == "two":
        data = b"".join(struct.pack(f"<{WIDTH}H", *row) for row in rows)
        plain("16UC1", data, 2 * WIDTH)
        plain("16UC1", data, 2 * WIDTH, topic="/rear/depth/image_raw")
    elif kind == "big_endian":
        plain("16UC1", b"".join(struct.pack(f">{WIDTH}H", *row) for row in rows), 2 * WIDTH, 1)
    elif kind == "float":
        missing = [math.nan, math.inf, -math.inf, 0.0, 70.0]
        values = [value / 1000 if value else missing[at % 5] for at, value in enumerate(flat)]
        plain("32FC1", struct.pack(f"<{len(values)}f", *values), 4 * WIDTH)
    elif kind == "colour":
        plain("rgb8", bytes(3 * WIDTH * HEIGHT), 3 * WIDTH)
    elif kind == "png":
        compressed("16UC1; compressedDepth png", struct.pack("<iff", 0, 0, 0) + png(rows))
    elif kind == "inverse":
        # As image_transport_plugins: quantisation 100, largest depth 10 m.
        a = 100.0 * 101.0
        b = 1.0 - a / 10.0
        quantised = [[int(a / (value / 1000) + b) if value else 0 for value in row] for row in rows]
        compressed("32FC1; compressedDepth png", struct.pack("<iff", 0, a, b) + png(quantised))
    elif kind == "rvl":
        compressed("16UC1; compressedDepth rvl", struct.pack("<iff", 0, 0, 0) + rvl[frame])


def small_bag(path, kind="raw", frames=range(FRAMES), info=True, tf=True, poses="topic", moving=False, rvl=None):
    bag = Bag(path)
    if tf:
        joints = [transform(START_NS, "base_link", "camera_link", vector(0.1, 0.02, 0.5), rotation())]
        if not moving:
            joints.append(transform(START_NS, "camera_link", "camera_optical_frame", vector(), OPTICAL))
        bag.write("/tf_static", "tf2_msgs/msg/TFMessage", START_NS, Record(transforms=joints))
    for frame in frames:
        for part in range(5):
            at_s = frame * 0.1 + part * 0.02
            at_ns = START_NS + frame * 100_000_000 + part * 20_000_000
            pose = (0.5 * at_s, -0.2 * at_s, 0.3 * at_s)
            if poses == "topic":
                bag.write("/odom", "nav_msgs/msg/Odometry", at_ns, odometry(at_ns, pose, (0.5, 0.3)), 2_000_000)
            elif poses == "tf":
                joint = transform(at_ns, "odom", "base_link", vector(pose[0], pose[1]), yaw(pose[2]))
                bag.write("/tf", "tf2_msgs/msg/TFMessage", at_ns, Record(transforms=[joint]))
            if moving:
                # A head that rises by 0.1 m/s.
                joint = transform(at_ns, "camera_link", "camera_optical_frame", vector(z=0.1 * at_s), OPTICAL)
                bag.write("/tf", "tf2_msgs/msg/TFMessage", at_ns, Record(transforms=[joint]))
        at_ns = START_NS + frame * 100_000_000
        if info:
            bag.write("/camera/depth/camera_info", "sensor_msgs/msg/CameraInfo", at_ns,
                      camera_info(at_ns, "camera_optical_frame", WIDTH, HEIGHT, (30.0, 31.0, 15.5, 11.5)))
        depth(bag, kind, frame, at_ns, rvl)
    if kind == "scan":
        for frame in frames:
            at_ns = START_NS + frame * 100_000_000
            ranges = [1.0 + 0.01 * beam for beam in range(90)] + [math.inf, math.nan, 0.01]
            bag.write("/scan", "sensor_msgs/msg/LaserScan", at_ns, Record(
                header=header(at_ns, "camera_link"), angle_min=-1.0, angle_max=0.84, angle_increment=0.02,
                time_increment=0.0, scan_time=0.1, range_min=0.1, range_max=12.0, ranges=ranges, intensities=[]))
    if kind == "words":
        bag.write("/chatter", "std_msgs/msg/String", START_NS, Record(data="hello"))
    bag.close()


def large_bag(path):
    """848 x 480, as a RealSense D435 sends: only the upper left pixel of each block of four is measured."""
    bag = Bag(path)
    width, height, at_ns = 848, 480, START_NS
    joint = transform(at_ns, "base_link", "camera", vector(z=0.5), OPTICAL)
    bag.write("/tf_static", "tf2_msgs/msg/TFMessage", at_ns, Record(transforms=[joint]))
    for frame in range(2):
        at_ns = START_NS + frame * 33_000_000
        bag.write("/odom", "nav_msgs/msg/Odometry", at_ns, odometry(at_ns, (0.0, 0.0, 0.0)))
        bag.write("/depth/camera_info", "sensor_msgs/msg/CameraInfo", at_ns,
                  camera_info(at_ns, "camera", width, height, (420.0, 420.0, 423.5, 239.5)))
        rows = [[2000 + row // 2 if row % 2 == 0 and col % 2 == 0 else 0 for col in range(width)] for row in range(height)]
        data = b"".join(struct.pack(f"<{width}H", *row) for row in rows)
        bag.write("/depth/image", "sensor_msgs/msg/Image", at_ns,
                  image(at_ns, "camera", width, height, "16UC1", data, 2 * width))
    bag.close()


def odd_bag(path, encoding, first_bytes):
    """One depth image whose encoding or encapsulation is not that of plain ROS 2."""
    with open(path, "wb") as file:
        writer = PlainWriter(file)
        writer.start(profile="ros2", library="odd")
        top = "sensor_msgs/msg/Image"
        schema = writer.register_schema(top, "ros2msg", text(top).encode())
        channel = writer.register_channel("/depth/image", encoding, schema)
        writer.add_message(channel, START_NS, first_bytes + bytes(64), START_NS)
        writer.finish()


LISTING = """rosbag2_bagfile_information:
  version: 5
  storage_identifier: mcap
  compression_format: ""
  compression_mode: ""
  relative_file_paths:
    - split_0.mcap
    - split_1.mcap
"""


def small(folder):
    os.makedirs(os.path.join(folder, "split"), exist_ok=True)
    path = lambda name: os.path.join(folder, name + ".mcap")
    rvl = []
    with open(os.path.join(folder, "frames.rvl"), "rb") as file:
        while size := file.read(4):
            rvl.append(file.read(struct.unpack("<I", size)[0]))
    for kind in ["raw", "big_endian", "float", "png", "inverse", "rvl", "colour", "two", "scan", "words"]:
        small_bag(path(kind), kind, info=kind not in ["scan", "words"], rvl=rvl)
    small_bag(path("moving"), moving=True, poses="tf")
    small_bag(path("no_info"), info=False)
    small_bag(path("no_tf"), tf=False)
    small_bag(path("no_odometry"), poses="none")
    small_bag(path("split/split_0"), frames=range(0, 3))
    small_bag(path("split/split_1"), frames=range(3, FRAMES))
    with open(os.path.join(folder, "split", "metadata.yaml"), "w") as file:
        file.write(LISTING)
    large_bag(path("large"))
    odd_bag(path("xcdr2"), "cdr", bytes([0, 7, 0, 0]))
    odd_bag(path("ros1"), "ros1", bytes(4))


def place(matrix, floor):
    """Base under the camera, facing where it looks; the camera as base sees it. World with +Y up."""
    upright = lambda v: (v[0], -v[2], v[1])
    columns = [upright((matrix[col], matrix[4 + col], matrix[8 + col])) for col in range(4)]
    right, down, ahead, (x, y, z) = columns
    angle = math.atan2(ahead[1], ahead[0])
    sin, cos = math.sin(angle), math.cos(angle)
    turned = [(cos * v[0] + sin * v[1], cos * v[1] - sin * v[0], v[2]) for v in (right, down, ahead)]
    r = [[turned[col][row] for col in range(3)] for row in range(3)]
    return (x, y, angle), vector(z=z - floor), quaternion(r)


def quaternion(r):
    trace = r[0][0] + r[1][1] + r[2][2]
    if trace > 0:
        s = 2 * math.sqrt(1 + trace)
        q = ((r[2][1] - r[1][2]) / s, (r[0][2] - r[2][0]) / s, (r[1][0] - r[0][1]) / s, s / 4)
    else:
        i = max(range(3), key=lambda at: r[at][at])
        j, k = (i + 1) % 3, (i + 2) % 3
        s = 2 * math.sqrt(1 + r[i][i] - r[j][j] - r[k][k])
        parts = [0.0] * 3
        parts[i], parts[j], parts[k] = s / 4, (r[j][i] + r[i][j]) / s, (r[k][i] + r[i][k]) / s
        q = (*parts, (r[k][j] - r[j][k]) / s)
    norm = math.sqrt(sum(part * part for part in q))
    return rotation(*[part / norm for part in q])


def walk(folder, rate, floor, out, raw=None):
    numbers = lambda name: [float(word) for word in open(os.path.join(folder, name)).read().split()]
    k, poses = numbers("K.txt"), numbers("poses.txt")
    names = sorted(name for name in os.listdir(os.path.join(folder, "depth")) if name.endswith(".png"))
    stream = open(raw, "rb") if raw else None
    bag = Bag(out)
    size = None
    for at, name in enumerate(names):
        at_ns = START_NS + int(int(name[:-4]) / rate * 1e9)
        base, offset, turn = place(poses[16 * at:16 * at + 16], floor)
        body = open(os.path.join(folder, "depth", name), "rb").read()
        width, height = struct.unpack(">II", body[16:24])
        size = size or (width, height)
        bag.write("/odom", "nav_msgs/msg/Odometry", at_ns, odometry(at_ns, base))
        joint = transform(at_ns, "base_link", "camera", offset, turn)
        bag.write("/tf", "tf2_msgs/msg/TFMessage", at_ns, Record(transforms=[joint]))
        bag.write("/depth/camera_info", "sensor_msgs/msg/CameraInfo", at_ns,
                  camera_info(at_ns, "camera", width, height, (k[0], k[4], k[2], k[5])))
        if stream:
            data = stream.read(2 * width * height)
            bag.write("/depth/image", "sensor_msgs/msg/Image", at_ns,
                      image(at_ns, "camera", width, height, "16UC1", data, 2 * width))
        else:
            data = struct.pack("<iff", 0, 0, 0) + body
            bag.write("/depth/image/compressedDepth", "sensor_msgs/msg/CompressedImage", at_ns,
                      Record(header=header(at_ns, "camera"), format="16UC1; compressedDepth png", data=data))
    bag.close()


def read(path):
    counts = {}
    with open(path, "rb") as file:
        for schema, channel, message, decoded in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            assert schema.encoding == "ros2msg" and channel.message_encoding == "cdr", (schema, channel)
            key = (channel.topic, schema.name)
            counts[key] = counts.get(key, 0) + 1
            if schema.name == "nav_msgs/msg/OccupancyGrid":
                assert len(decoded.data) == decoded.info.width * decoded.info.height
                assert all(-1 <= cell <= 100 for cell in decoded.data)
            if schema.name == "sensor_msgs/msg/Image":
                assert len(decoded.data) == decoded.step * decoded.height
    for (topic, name), count in sorted(counts.items()):
        print(topic, name, count)


if __name__ == "__main__":
    command, rest = sys.argv[1], sys.argv[2:]
    if command == "small":
        small(rest[0])
    elif command == "walk":
        walk(rest[0], float(rest[1]), float(rest[2]), *rest[3:])
    elif command == "read":
        read(rest[0])
