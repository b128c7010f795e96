#!/usr/bin/env python3
"""A robot in an empty hall: stands where camera and base driver stand. Put your sensors and wheels in place of Hall.

    sidestep interface --python > sidestep.py      # beside this file, from the same version of sidestep

Frames: odom (z up), base (on the floor below the axle, x forward, y left), camera (optical: x right, y down, z forward).
Units: m, rad, s; stamps in ns of graph time, which on a robot is CLOCK_MONOTONIC (sidestep.host_ns()).
"""
import math
import sidestep
from sidestep import Isometry, PathPoint, Pose2, Twist

WIDTH, HEIGHT, FOCAL_PX, RATE_HZ = 160, 120, 151.7, 30.0  # [px], [Hz]
FORWARD_M, UP_M, DOWN_RAD, FAR_M = 0.10, 0.55, 0.1745329, 3.5  # the camera in base: as in robot.toml
BRAKE_M_S2, FASTER_M_S2, TURN_RAD_S2 = 0.6, 1.0, 3.0


class Hall:
    """The wheels and the floor. A camera's depth is along its axis z, so a level floor has one depth per row."""

    def __init__(self):
        self.x_m = self.y_m = self.yaw_rad = self.v_m_s = self.w_rad_s = 0.0
        self.wish, self.valid_until_ns, self.now_ns = Twist(), 0, None

    def obey(self, command):
        self.wish, self.valid_until_ns = command.twist, command.valid_until_ns

    def drive(self, now_ns):
        dt_s = (now_ns - (self.now_ns or now_ns)) * 1e-9
        self.now_ns = now_ns
        if now_ns >= self.valid_until_ns:  # nobody commands: brake without being told
            self.wish = Twist()
        change = self.wish.v_m_s - self.v_m_s
        self.v_m_s += max(-BRAKE_M_S2 * dt_s, min(FASTER_M_S2 * dt_s, change))
        self.w_rad_s += max(-TURN_RAD_S2 * dt_s, min(TURN_RAD_S2 * dt_s, self.wish.w_rad_s - self.w_rad_s))
        self.x_m += self.v_m_s * math.cos(self.yaw_rad) * dt_s
        self.y_m += self.v_m_s * math.sin(self.yaw_rad) * dt_s
        self.yaw_rad += self.w_rad_s * dt_s

    def photograph(self, frame):
        frame.width, frame.height, frame.metres_per_unit = WIDTH, HEIGHT, 0.001
        frame.fx_px = frame.fy_px = FOCAL_PX
        frame.cx_px, frame.cy_px = WIDTH / 2 - 0.5, HEIGHT / 2 - 0.5
        c, s = math.cos(DOWN_RAD / 2) / 2, math.sin(DOWN_RAD / 2) / 2
        frame.camera = Isometry((FORWARD_M, 0.0, UP_M), (-c - s, c + s, s - c, c - s))
        for row in range(HEIGHT):
            fall = (row - frame.cy_px) / FOCAL_PX * math.cos(DOWN_RAD) + math.sin(DOWN_RAD)  # [m] per m of depth
            depth_m = UP_M / fall if fall > UP_M / FAR_M else 0.0  # 0 = no measurement
            frame.pixels[row * WIDTH : (row + 1) * WIDTH] = [round(depth_m * 1000)] * WIDTH


link, hall = sidestep.Link(), Hall()
commands = sidestep.Reader(link, "command")
depth, odometry, path = (sidestep.Writer(link, topic) for topic in ("depth", "odometry", "path"))
hall.photograph(depth.message)
path.message.id, path.message.count, path.message.pose_epoch = 1, 200, link.incarnation
for i in range(200):
    path.message.points[i] = PathPoint(0.25 * i, 0.0)  # in odom: 50 m straight on

for now_ns, is_frame in link.timeline(RATE_HZ):
    for command, _ in commands.each():
        hall.obey(command)
    hall.drive(now_ns)
    if is_frame:
        depth.message.capture_ns = now_ns  # of the exposure: subtract your camera's latency
        depth.send(now_ns)
        continue
    state = odometry.message
    state.stamp_ns, state.twist = now_ns, Twist(hall.v_m_s, hall.w_rad_s)
    state.pose = Pose2(hall.x_m, hall.y_m, math.remainder(hall.yaw_rad, 2 * math.pi))
    state.pose_epoch = link.incarnation  # a driver that starts again has lost its pose: what was mapped is void
    odometry.send(now_ns)
    if path.sequence == 0:
        path.send(now_ns)
